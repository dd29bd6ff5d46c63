#!/usr/bin/env python3
"""Many short videos three ways: a loop of `foveate track`, one `foveate track` for all, and Ray whose workers are killed.

    pip install . "ray==2.60.0"                      # and ffmpeg, which cuts the clips
    python bench/many_videos.py --data data/tracking data/tracking-wide --out out-many

Cuts `--clips` H.264 clips of 25 frames out of sequences in OTB's layout, with the first box of each in `NAME.txt`, and three that are
damaged (no video at all, one that ends early, one without a first box). Then measures the wall time of

1. a loop, one process a clip,
2. `foveate track clips/*.mp4`,
3. `python -m foveate.ray --workers 2`, with `--kills` of its workers killed by SIGKILL while they track, at random moments.

Fails where the files of a clip differ in a byte from those of the loop, a damaged clip is not listed, or another one is.
"""

from __future__ import annotations

import argparse
import filecmp
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

FRAMES = 25
PROGRAM = [sys.executable, "-m", "foveate"]


def sequences(folders: list[Path]) -> list[tuple[str, list[Path], list[str]]]:
    """Name, pictures and lines of truth."""
    found = []
    for folder in sorted(inner for outer in folders for inner in outer.iterdir() if (inner / "groundtruth_rect.txt").is_file()):
        pictures = sorted(p for p in (folder / "img").iterdir() if p.suffix in (".jpg", ".png"))
        lines = (folder / "groundtruth_rect.txt").read_text().split("\n")
        found.append((folder.name, pictures, [line.replace("\t", ",") for line in lines]))
    return found


def is_box(line: str) -> bool:
    try:
        x, y, w, h = (float(word) for word in line.split(","))
    except ValueError:
        return False
    return x >= 1 and y >= 1 and w >= 8 and h >= 8


def cut(folders: list[Path], clips: Path, count: int) -> None:
    """Clips in turn from all sequences, each from where the one before it ended, over again where all are used up."""
    clips.mkdir(parents=True)
    starts = [
        (start, name, pictures, lines)
        for name, pictures, lines in sequences(folders)
        for start in range(0, min(len(pictures), len(lines)) - FRAMES, FRAMES)
        if is_box(lines[start])
    ]
    starts.sort(key=lambda start: start[:2])
    if len(starts) < count:
        raise SystemExit(f"the sequences have {len(starts)} clips of {FRAMES} frames, fewer than {count}")
    for start, name, pictures, lines in starts[:count]:
        clip = clips / f"{name}-{start:04d}.mp4"
        shown = b"".join(picture.read_bytes() for picture in pictures[start : start + FRAMES])
        command = ["ffmpeg", "-v", "error", "-f", "image2pipe", "-framerate", "25", "-i", "-"]
        command += ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p"]
        subprocess.run([*command, str(clip)], input=shown, check=True)
        clip.with_suffix(".txt").write_text(lines[start] + "\n")
    whole = sorted(clips.glob("*.mp4"))
    (clips / "damaged-empty.mp4").write_bytes(b"no video")
    (clips / "damaged-short.mp4").write_bytes(whole[0].read_bytes()[:3000])
    shutil.copy(whole[0], clips / "damaged-unknown.mp4")
    for name in ("empty", "short"):
        shutil.copy(whole[0].with_suffix(".txt"), clips / f"damaged-{name}.txt")


def loop(clips: list[Path], out: Path, options: list[str]) -> int:
    out.mkdir()
    command = [*PROGRAM, "track"]
    done = [subprocess.run([*command, str(c), "--out", str(out / c.stem), *options], capture_output=True) for c in clips]
    return sum(one.returncode != 0 for one in done)


def at_once(clips: list[Path], out: Path, options: list[str]) -> int:
    subprocess.run([*PROGRAM, "track", *map(str, clips), "--out", str(out), *options], capture_output=True)
    return len((out / "failures.txt").read_text().splitlines())


def tracking(process: int) -> list[int]:
    """Ray's workers at work, of those that descend from a process."""
    parents, at_work = {}, []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parents[int(folder.name)] = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
                if (folder / "cmdline").read_bytes().startswith(b"ray::track"):
                    at_work.append(int(folder.name))
            except OSError:
                continue

    def descends(one: int) -> bool:
        while one > 1 and one != process:
            one = parents.get(one, 0)
        return one == process

    return [worker for worker in at_work if descends(worker)]


def on_ray(clips: list[Path], out: Path, options: list[str], kills: int, rng: random.Random) -> int:
    # The program has one thread for each task by itself.
    words = [sys.executable, "-m", "foveate.ray", "--workers", "2", "--videos", *map(str, clips), "--out", str(out), "--"]
    with subprocess.Popen([*words, *options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        for done in sorted(rng.sample(range(1, len(clips) - 20), kills)):
            while len(list(out.glob("*.json"))) < done and process.poll() is None:
                time.sleep(0.01)
            time.sleep(rng.uniform(0, 0.2))
            while process.poll() is None:
                if at_work := tracking(process.pid):
                    victim = rng.choice(at_work)
                    os.kill(victim, signal.SIGKILL)
                    print(f"killed worker {victim} after {len(list(out.glob('*.json')))} results")
                    break
    return len((out / "failures.txt").read_text().splitlines())


def timed(name: str, work: Callable[[], int]) -> int:
    began = time.monotonic()
    failed = work()
    print(f"{name}: {time.monotonic() - began:.1f} s, {failed} failed", flush=True)
    return failed


def differing(clips: list[Path], one: Path, other: Path) -> list[str]:
    """Clips whose folders do not have the same files, byte for byte."""
    found = []
    for clip in clips:
        here, there = one / clip.stem, other / clip.stem
        names = [sorted(p.name for p in folder.iterdir()) if folder.is_dir() else [] for folder in (here, there)]
        if names[0] != names[1] or filecmp.cmpfiles(here, there, names[0], shallow=False)[0] != names[0]:
            found.append(clip.stem)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="folders of sequences in OTB's layout")
    parser.add_argument("--out", type=Path, default=Path("out-many"), help="folder for clips and results")
    parser.add_argument("--clips", type=int, default=200)
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1, help="of the moments at which workers are killed")
    parser.add_argument("--options", default="--profile fast --no-video --no-report", help="of foveate track")
    args = parser.parse_args()
    folder, options = args.out / "clips", args.options.split()
    if not folder.is_dir():
        part = args.out / "clips.part"
        shutil.rmtree(part, ignore_errors=True)
        cut(args.data, part, args.clips)
        part.rename(folder)
    clips = sorted(folder.glob("*.mp4"))
    damaged = [clip for clip in clips if clip.stem.startswith("damaged-")]
    ways = {way: args.out / way for way in ("loop", "at-once", "ray")}
    for out in ways.values():
        shutil.rmtree(out, ignore_errors=True)
    one = [*options, "--threads", "1"]
    failed = [
        timed("a loop of foveate track", lambda: loop(clips, ways["loop"], one)),
        timed("foveate track clips/*.mp4", lambda: at_once(clips, ways["at-once"], one)),
        timed("python -m foveate.ray", lambda: on_ray(clips, ways["ray"], options, args.kills, random.Random(args.seed))),
    ]
    wrong = {way: differing(clips, ways["loop"], ways[way]) for way in ("at-once", "ray")}
    lists = [sorted(Path(line.split("\t")[0]).stem for line in (ways[way] / "failures.txt").open()) for way in ("at-once", "ray")]
    print(f"{len(clips)} clips, {len(damaged)} of them damaged; differing from the loop: {wrong}; failures: {lists[1]}")
    if failed != [len(damaged)] * 3 or any(wrong.values()) or any(names != [c.stem for c in damaged] for names in lists):
        raise SystemExit("the results are not the same")


if __name__ == "__main__":
    main()
