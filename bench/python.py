#!/usr/bin/env python3
"""What the Python package costs beside the Rust library: the time of an update at 640 x 480, and memory over many updates.

    pip install .
    cargo build --release --manifest-path python/Cargo.toml --target-dir python/target --example facade
    python bench/python.py time --facade python/target/release/examples/facade
    python bench/python.py memory --updates 100000

`time` runs both in turns on the same bytes (a textured square of 80 px), on as many threads, and compares each frame's least
time over the rounds, so that other work on the machine does not count; taking the pixels apart is part of both. It fails where boxes differ in a bit. `memory` prints the resident memory as updates go on.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import foveate

SIZE, SIDE = (640, 480), 80


def pictures(frames: int) -> list[Any]:
    rng = np.random.default_rng(7)
    back = rng.integers(0, 60, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
    square = rng.integers(100, 256, (SIDE, SIDE, 3)).astype(np.uint8)
    found = []
    for t in range(frames):
        picture = back.copy()
        x, y = 100 + 3 * (t % 140 if t % 280 < 140 else 140 - t % 140), 150 + t % 60
        picture[y : y + SIDE, x : x + SIDE] = square
        found.append(picture)
    return found


FIRST = (100, 150, SIDE, SIDE)


def of_python(shown: list[Any]) -> tuple[list[Any], list[float]]:
    tracker = foveate.Tracker("balanced")
    tracker.init(shown[0], FIRST)
    boxes, seconds = [], []
    for picture in shown[1:]:
        start = time.perf_counter()
        seen = tracker.update(picture)
        box = seen.box
        seconds.append(time.perf_counter() - start)
        boxes.append(tuple(box))
    return boxes, seconds


def of_rust(facade: Path, frames: Path, count: int) -> tuple[list[Any], list[float]]:
    words = [str(facade), str(frames), *map(str, SIZE), str(count), *map(str, FIRST)]
    lines = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    boxes = [tuple(float(v) for v in line.split()) for line in lines[:-1]]
    return boxes, [float(v) for v in lines[-1].split()[1:]]


def run_time(args: argparse.Namespace) -> None:
    os.environ["RAYON_NUM_THREADS"] = str(args.threads)  # read at the first update, here and there
    shown = pictures(args.frames)
    python, rust = [], []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "frames.rgb"
        file.write_bytes(b"".join(p.tobytes() for p in shown))
        for _ in range(args.rounds):
            found, seconds = of_python(shown)
            wanted, others = of_rust(args.facade, file, args.frames)
            assert found == wanted, "boxes differ"
            python.append(seconds)
            rust.append(others)
    p, r = (sum(map(min, zip(*times))) / (args.frames - 1) for times in (python, rust))
    print(f"{args.frames} frames of {SIZE[0]} x {SIZE[1]}, {args.threads} thread(s), {args.rounds} rounds, same boxes bit for bit")
    print(f"an update, each frame's least time over the rounds: Python {1e3 * p:.3f} ms, Rust {1e3 * r:.3f} ms; ratio {p / r:.3f}")


def resident() -> float:
    """Resident memory now, MB."""
    statm = Path("/proc/self/statm")
    if statm.exists():
        return int(statm.read_text().split()[1]) * resource.getpagesize() / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10


def run_memory(args: argparse.Namespace) -> None:
    shown = [p[100:340, 60:420] for p in pictures(60)]
    tracker = foveate.Tracker("fast", channels="bgr")
    tracker.init(shown[0], (40, 50, SIDE, SIDE))
    sizes = []
    for t in range(args.updates + 1):
        seen = tracker.update(shown[t % 60])
        ok, box = seen
        seen.particles, seen.weights, seen.region(), seen.covariance
        if t % (args.updates // 10) == 0:
            sizes.append(resident())
            print(f"{t:8} updates  {sizes[-1]:8.2f} MB", flush=True)
    print(f"growth over the last nine tenths: {sizes[-1] - sizes[1]:.2f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    timed = commands.add_parser("time")
    timed.add_argument("--facade", type=Path, required=True)
    timed.add_argument("--frames", type=int, default=200)
    timed.add_argument("--rounds", type=int, default=7)
    timed.add_argument("--threads", type=int, default=1)
    timed.set_defaults(run=run_time)
    memory = commands.add_parser("memory")
    memory.add_argument("--updates", type=int, default=100_000)
    memory.set_defaults(run=run_memory)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
