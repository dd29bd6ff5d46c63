#!/usr/bin/env python3
"""Runs other trackers (CSRT, KCF, dlib) on the digit videos of `cargo run --release -p paper -- reproduce`, to compare them in its tables.

Usage:
  pip install opencv-contrib-python dlib
  cargo build --release
  bench/peers.py --foveate target/release/foveate --data data --seeds 10 --out peers.csv
  cargo run --release -p paper -- reproduce table1 table3 --data data --peer peers.csv

--data is the folder with MNIST's test files, --seeds the number of videos of each digit; --experiment, --digits and
--frames choose a part. Trackers that are not installed are left out. One thread.

Each video is written by `foveate synth`, read, and deleted. A tracker gets the true box in frame 1 and nothing more;
where it reports a failure, its last box is kept. Output: one line per video. mean and spread: mean and standard deviation
of the centre error from frame 2 on, pixels. off_at_end: 1 if the mean error of the last 20 frames exceeds 15 px.
"""
import argparse
import glob
import math
import os
import subprocess
import sys
import tempfile

import cv2

from trackers import trackers

SCENES = {
    ("table1", "clean"): ["clutter"],
    ("table1", "30 % salt and pepper"): ["clutter", "--noise"],
    ("table3", "bars and noise"): ["partial"],
}


def centre_errors(make, images, truth):
    tracker, box, errors = make(), truth[0], []
    tracker.start(images[0], box)
    for image, (tx, ty, tw, th) in zip(images[1:], truth[1:]):
        box = tracker.follow(image) or box
        x, y, w, h = box
        errors.append(math.hypot(x + w / 2 - tx - tw / 2, y + h / 2 - ty - th / 2))
    return errors


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--foveate", default="foveate", help="the program")
    parser.add_argument("--data", default=os.environ.get("FOVEATE_DATA", "data"), help="folder with MNIST's test files")
    parser.add_argument("--experiment", action="append", choices=["table1", "table3"], help="may be repeated; default: both")
    parser.add_argument("--digits", default="0123456789")
    parser.add_argument("--seeds", type=int, default=10, help="videos of each digit")
    parser.add_argument("--frames", type=int, default=300, help="length of each video")
    parser.add_argument("--out", default="peers.csv")
    args = parser.parse_args()
    peers = dict(peer for short, peer in trackers().items() if short in ("csrt", "kcf", "dlib"))
    rows = []
    for (experiment, scene), synth in SCENES.items():
        if args.experiment and experiment not in args.experiment:
            continue
        for digit in args.digits:
            for seed in range(1, args.seeds + 1):
                with tempfile.TemporaryDirectory() as folder:
                    command = [args.foveate, "synth", *synth, "--digit", digit, "--seed", str(seed)]
                    command += ["--frames", str(args.frames), "--data", args.data, "--out", f"{folder}/video"]
                    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
                    images = [cv2.imread(path) for path in sorted(glob.glob(f"{folder}/video/img/*.png"))]
                    with open(f"{folder}/video/groundtruth_rect.txt") as file:
                        boxes = [[float(v) for v in line.split(",")] for line in file]
                truth = [(x - 1, y - 1, w, h) for x, y, w, h in boxes]
                for name, make in peers.items():
                    errors = centre_errors(make, images, truth)
                    mean = sum(errors) / len(errors)
                    spread = math.sqrt(sum((e - mean) ** 2 for e in errors) / len(errors))
                    off = int(sum(errors[-20:]) / len(errors[-20:]) > 15)
                    rows.append(f"{experiment},{scene},{name},{digit},{seed},{mean:.6g},{spread:.6g},{off}")
            print(f"{experiment}, {scene}: digit {digit} is done", file=sys.stderr)
    part = f"{args.out}.tmp"
    with open(part, "w") as file:
        file.write("# " + " ".join(sys.argv) + "\n")
        file.write("experiment,scene,tracker,digit,seed,mean,spread,off_at_end\n" + "\n".join(rows) + "\n")
    os.replace(part, args.out)


if __name__ == "__main__":
    main()
