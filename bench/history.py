#!/usr/bin/env python3
"""Measures the program against peers in one run, compares the ratios with those of earlier commits, and keeps them.

Usage:
  bench/history.py target/release/foveate                    # prints the ratios beside the last ones kept for this build and processor
  bench/history.py target/release/foveate --keep             # and appends them to bench/history.json
  bench/history.py target/debug/foveate --rounds 3           # as .ci/run does

A ratio is the processor time of a whole run (reading, tracking, writing; one thread) over that of a peer just before and after it: zlib
compresses a text, which every Python has; OpenCV's CSRT follows the same digit, where OpenCV is installed. The scenes are drawn. A run is
marked if three quarters of its ratios exceed the earlier median by more than --tolerance. Nothing fails, since machines are noisy.
"""
import argparse
import datetime
import glob
import json
import os
import platform
import random
import resource
import statistics
import subprocess
import tempfile
import time
import zlib

HISTORY = os.path.join(os.path.dirname(os.path.abspath(__file__)), "history.json")
ROOT = os.path.dirname(os.path.dirname(HISTORY))


def runs(program, folder):
    """The commands that are measured, by name. Makes their scenes."""
    quiet = {"check": True, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    for scene, out, frames in (("clutter", "digit", 150), ("clutter", "short", 60), ("multi", "digits", 150)):
        subprocess.run([program, "synth", scene, "--frames", str(frames), "--out", f"{folder}/{out}"], **quiet)
    box = first_box(f"{folder}/digit/groundtruth_rect.txt")
    boxes = [first_box(path) for path in sorted(glob.glob(f"{folder}/digits/groundtruth_rect.*.txt"))]
    with open(f"{folder}/inits.txt", "w", encoding="utf-8") as file:
        file.writelines(f"1,{number},{box},1\n" for number, box in enumerate(boxes, 1))
    track = [program, "track", "--threads", "1", "--no-report", "--out", f"{folder}/out"]
    one, many = [*track, f"{folder}/digit", "--init", box, "-c"], [*track, f"{folder}/digits/img1"]
    film = [*track, f"{folder}/short", "--init", box, "-c", "natural-fast"]
    subprocess.run(film, **quiet)
    os.rename(f"{folder}/out/annotated.mp4", f"{folder}/film.mp4")
    commands = {
        "natural": [*one, "natural"],
        "natural-fast": [*one, "natural-fast"],
        "digits-hedge": [*one, "digits-hedge"],
        "multi, 5 targets": [*many, "--inits", f"{folder}/inits.txt", "-c", "multi"],
        "H.264": [*track, f"{folder}/film.mp4", "--init", box, "-c", "natural-fast"],
    }
    return {name: [*command, "--no-video"] for name, command in commands.items()} | {"film": film}


def first_box(path):
    with open(path, encoding="utf-8") as file:
        return file.readline().strip()


def peers(digit):
    """What the program is compared with: functions, by name."""
    text = "".join(random.Random(7).choices("abcdefgh ", k=2_000_000)).encode()
    found = {"zlib": lambda: zlib.compress(text, 6)}
    try:
        from trackers import follow, trackers
    except ImportError:
        return found
    paths = sorted(glob.glob(f"{digit}/img/*"))[:40]
    box = tuple(float(v) for v in first_box(f"{digit}/groundtruth_rect.txt").split(","))
    csrt = [make for short, (_, make) in trackers().items() if short == "csrt"]
    return found | {"CSRT": lambda: follow(make, paths, box) for make in csrt}


def cost(command):
    """Processor seconds of a program."""
    spent = lambda: sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    before = spent()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return spent() - before


def own_cost(function):
    before = time.process_time()
    function()
    return time.process_time() - before


def ratios(program, rounds):
    """For each peer and command the quartiles, over the rounds, of its time over the peer's just before and after it."""
    with tempfile.TemporaryDirectory() as folder:
        commands = runs(program, folder)
        others = peers(f"{folder}/digit")
        found = {peer: {name: [] for name in commands} for peer in others}
        times = lambda: {peer: own_cost(function) for peer, function in others.items()}
        before = times()
        for _ in range(rounds):
            for name, command in commands.items():
                seconds, after = cost(command), times()
                for peer in others:
                    found[peer][name].append(2 * seconds / (before[peer] + after[peer]))
                before = after
        return {peer: {name: quartiles(of) for name, of in runs.items()} for peer, runs in found.items()}


def quartiles(values):
    return [round(v, 3) for v in statistics.quantiles(values, n=4, method="inclusive")]


def processor():
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return next(line.split(":")[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def commit():
    try:
        return subprocess.run(["git", "-C", ROOT, "log", "-1", "--format=%s"], capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", help="the program; its folder's name is the build that is compared")
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--tolerance", type=float, default=0.05, help="how much slower is marked")
    parser.add_argument("--keep", action="store_true", help=f"append the ratios to {os.path.relpath(HISTORY)}")
    args = parser.parse_args()
    program = os.path.abspath(args.program)
    history = []
    if os.path.exists(HISTORY):
        with open(HISTORY, encoding="utf-8") as file:
            history = json.load(file)
    build = os.path.basename(os.path.dirname(program))
    now = {"date": datetime.date.today().isoformat(), "commit": commit(), "build": build, "processor": processor()}
    now["ratios"] = ratios(program, max(args.rounds, 2))
    last = next((x for x in reversed(history) if all(x[k] == now[k] for k in ("build", "processor"))), None)
    before = f"{last['date']}, '{last['commit']}'" if last else f"nothing is kept for the build '{build}' on {now['processor']}"
    print(f"processor time over the peer's: quartiles of {max(args.rounds, 2)} rounds; before: {before}")
    print(f"{'run':17} {'peer':5} {'25 %':>6} {'50 %':>6} {'75 %':>6} {'before':>7}")
    slower = 0
    for peer, of in now["ratios"].items():
        for name, found in of.items():
            earlier = last and last["ratios"].get(peer, {}).get(name)
            row = f"{name:17} {peer:5} " + " ".join(f"{v:6.3f}" for v in found)
            if earlier:
                row += f" {earlier[1]:7.3f}"
                if found[0] > earlier[1] * (1 + args.tolerance):
                    slower += 1
                    row += f"  slower by {found[1] / earlier[1] - 1:.0%}"
            print(row)
    if last:
        print(f"{slower} slower by more than {args.tolerance:.0%}")
    if args.keep:
        with open(HISTORY, "w", encoding="utf-8") as file:
            json.dump([*history, now], file, indent=1)
            file.write("\n")


if __name__ == "__main__":
    main()
