#!/usr/bin/env python3
"""Times a drawn crowd with given boxes, of which a tenth is missing (docs/looking.md).

Usage:
  bench/mot/crowd.py --foveate target/release/foveate --out out-crowd       # NumPy and OpenCV

Rectangles of 12 x 30 pixels walk over a blurred noise of 1920 x 1080 pixels; detections have errors of a pixel. The tracks start in
the first frames, which take longest: the frames after --first are timed by the difference of two runs.

Output: OUT/FRAMES/ (pictures and det.txt, made once) and, printed, processor time and elapsed time a frame.
"""
import argparse
import os
import resource
import subprocess
import time

import cv2
import numpy as np

WIDTH, HEIGHT, W, H = 1920, 1080, 12, 30


def draw(folder, frames, targets, seed=0):
    rng = np.random.default_rng(seed)
    ground = cv2.GaussianBlur(rng.integers(60, 180, (HEIGHT, WIDTH, 3)).astype("u1"), (0, 0), 6)
    room = np.array([WIDTH - W - 2, HEIGHT - H - 2])
    place, velocity = rng.uniform([0, 0], room, (targets, 2)), rng.normal(0, 1.2, (targets, 2))
    colours, lines = rng.integers(0, 255, (targets, 3)), []
    os.makedirs(folder, exist_ok=True)
    for t in range(1, frames + 1):
        picture = ground.copy()
        for (x, y), colour in zip(place, colours):
            cv2.rectangle(picture, (int(x), int(y)), (int(x) + W, int(y) + H), colour.tolist(), -1)
            if rng.random() > 0.1:
                dx, dy, dw, dh = rng.normal(0, [1, 1, 0.5, 1])
                box = f"{x + 1 + dx:.2f},{y + 1 + dy:.2f},{W + dw:.2f},{H + dh:.2f}"
                lines.append(f"{t},-1,{box},{rng.uniform(0.5, 1):.3f}")
        place += velocity
        velocity[(place < 0) | (place > room)] *= -1
        place = place.clip(0, room)
        cv2.imwrite(os.path.join(folder, f"{t:06}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 92])
    with open(os.path.join(folder, "det.txt"), "w") as file:
        file.write("\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--foveate", default="foveate")
    parser.add_argument("--targets", type=int, default=1000)
    parser.add_argument("--looks", type=int, default=10, help="looks a frame")
    parser.add_argument("--first", type=int, default=10, help="frames that are not timed")
    parser.add_argument("--frames", type=int, default=310)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--out", default="out-crowd")
    args = parser.parse_args()

    def run(frames, threads):
        folder = os.path.join(args.out, str(frames))
        if not os.path.exists(os.path.join(folder, "det.txt")):
            draw(folder, frames, args.targets)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        began = time.perf_counter()
        subprocess.run(
            [args.foveate, "track", folder, "--detections", os.path.join(folder, "det.txt"), "--no-video", "--no-report",
             "--threads", str(threads), "--set", f"multi_target.attention.budget={args.looks}",
             "--out", os.path.join(args.out, "run")], check=True, capture_output=True)
        now = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.perf_counter() - began, now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime

    print("| threads | start, s | ms a frame | processor, ms a frame | frames/s |")
    print("| --- | --- | --- | --- | --- |")
    for threads in args.threads:
        (first, first_used), (whole, used) = run(args.first, threads), run(args.frames, threads)
        frames = args.frames - args.first
        wall = (whole - first) / frames
        print(f"| {threads} | {first:.1f} | {1e3 * wall:.0f} | {1e3 * (used - first_used) / frames:.0f} | {1 / wall:.0f} |", flush=True)


if __name__ == "__main__":
    main()
