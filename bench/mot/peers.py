#!/usr/bin/env python3
"""Runs SORT, ByteTrack and OC-SORT on detections of many targets, to compare them with `foveate track --detections`.

Usage:
  pip install trackers==2.6.1
  bench/mot/peers.py --data data/mot --out out-mot                              # det/det.txt of each sequence
  bench/mot/peers.py --data data/mot --out out-mot-jitter --jitter 5 --keep 1   # true boxes with noise, five seeds
  foveate eval --mot --truth data/mot --results out-mot/sort out-mot/bytetrack out-mot/ocsort

--data is a folder of sequences in MOTChallenge's layout: seqinfo.ini, det/det.txt, gt/gt.txt. With --jitter N the
detections are the true boxes instead, drawn N times: centre and size of each get Gaussian noise of --noise (0.05) of its
width and height; a share of 1 - KEEP is left out. Every tracker has its package's defaults and the frame rate of seqinfo.ini.

Output: OUT/TRACKER/SEQUENCE.txt, or with --jitter OUT/seed-N/TRACKER/SEQUENCE.txt and the detections
OUT/seed-N/det/SEQUENCE.txt, for foveate.
"""
import argparse
import collections
import configparser
import math
import os
import random

import numpy as np
import supervision as sv
import trackers as package

KINDS = {"sort": "SORTTracker", "bytetrack": "ByteTrackTracker", "ocsort": "OCSORTTracker"}


def read(path):
    """Lines of a file as (frame, id, x, y, w, h, confidence)."""
    with open(path) as file:
        rows = [[float(v) for v in line.replace(" ", ",").split(",")[:7]] for line in file if line.strip()]
    return [(int(row[0]), int(row[1]), *row[2:7]) for row in rows]


def jittered(truth, seed, noise, keep):
    rng, rows = random.Random(seed), []
    for frame, _, x, y, w, h, counts in sorted(truth):
        if int(counts) == 0 or rng.random() >= keep:
            continue
        cx, cy = x + w / 2 + rng.gauss(0, noise * w), y + h / 2 + rng.gauss(0, noise * h)
        w, h = w * math.exp(rng.gauss(0, noise)), h * math.exp(rng.gauss(0, noise))
        rows.append((frame, -1, cx - w / 2, cy - h / 2, w, h, 1.0))
    return rows


def follow(tracker, rows, frames):
    by_frame, lines = collections.defaultdict(list), []
    for row in rows:
        by_frame[row[0]].append(row)
    for frame in range(1, frames + 1):
        found = by_frame[frame]
        boxes = np.array([[x, y, x + w, y + h] for _, _, x, y, w, h, _ in found], float).reshape(-1, 4)
        confidence = np.array([row[6] for row in found], float)
        seen = tracker.update(sv.Detections(xyxy=boxes, confidence=confidence, class_id=np.zeros(len(found), int)))
        ids = seen.tracker_id if seen.tracker_id is not None else []
        for (x0, y0, x1, y1), name in zip(seen.xyxy, ids):
            if name >= 0:
                lines.append(f"{frame},{name + 1},{x0:.3f},{y0:.3f},{x1 - x0:.3f},{y1 - y0:.3f},1,-1,-1,-1")
    return lines


def write(path, lines):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w") as file:
        file.write("".join(f"{line}\n" for line in lines))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", default="data/mot", help="folder of sequences")
    parser.add_argument("--out", default="out-mot")
    parser.add_argument("--jitter", type=int, default=0, metavar="N", help="true boxes with noise, N seeds")
    parser.add_argument("--noise", type=float, default=0.05, help="standard deviation, share of the box")
    parser.add_argument("--keep", type=float, default=1.0, help="share of the true boxes that are detected")
    args = parser.parse_args()
    kinds = {name: getattr(package, kind) for name, kind in KINDS.items() if hasattr(package, kind)}
    for sequence in sorted(os.listdir(args.data)):
        folder = os.path.join(args.data, sequence)
        about = configparser.ConfigParser()
        if not about.read(os.path.join(folder, "seqinfo.ini")):
            continue
        rate, frames = about.getfloat("Sequence", "frameRate"), about.getint("Sequence", "seqLength")
        runs = [(args.out, read(f"{folder}/det/det.txt"))] if args.jitter == 0 else []
        for seed in range(1, args.jitter + 1):
            out, rows = f"{args.out}/seed-{seed}", jittered(read(f"{folder}/gt/gt.txt"), seed, args.noise, args.keep)
            write(f"{out}/det/{sequence}.txt", [",".join(f"{v:g}" for v in row) for row in rows])
            runs.append((out, rows))
        for out, rows in runs:
            for name, kind in kinds.items():
                write(f"{out}/{name}/{sequence}.txt", follow(kind(frame_rate=rate), rows, frames))


if __name__ == "__main__":
    main()
