#!/usr/bin/env python3
"""Compares a sensor that reads windows with whole pictures of fewer pixels and with fewer pictures, at a given bandwidth.

Usage:
  pip install numpy opencv-python-headless
  bench/bandwidth.py copies --seqs data/tracking data/tracking-wide data/tracking-train --out out-bandwidth
  for kind in coarse rare; do foveate eval --config natural --seqs out-bandwidth/$kind --out out-$kind; done
  foveate eval --config natural --set sensor.overview=52 --set sensor.fovea=[4.0,40.0] --out out-windows \
      --seqs data/tracking data/tracking-wide data/tracking-train
  bench/bandwidth.py scores out-bandwidth out-windows out-coarse out-rare

Copies of each sequence, in OTB layout, with a 16th of the pixels (--share): `coarse` has pictures of a quarter of the width and height, the
mean of 4 x 4 pixels each; `rare` has every 16th picture. Between two pictures of `rare` the box moves on with the velocity of the last two.
Scores are AUC and the share of frames without overlap (failure, %) over all frames of the original sequences, and paired differences from
the first folder, with 95 % bootstrap intervals over sequences.
"""
import argparse
import glob
import os

import cv2
import numpy as np


def boxes(path):
    """Rows of x, y, width, height in pixels, counted from 1."""
    return np.array([[float(x) for x in line.replace("\t", ",").replace(" ", ",").split(",")[:4]] for line in open(path) if line.strip()])


def pictures(folder):
    video = f"{folder}/video.mp4"
    if not os.path.exists(video):
        yield from map(cv2.imread, sorted(glob.glob(f"{folder}/img/*")))
        return
    reader = cv2.VideoCapture(video)
    while (frame := reader.read())[0]:
        yield frame[1]


def copies(args):
    side = round(args.share ** 0.5)
    for truth in sorted(path for folder in args.seqs for path in glob.glob(f"{folder}/*/groundtruth_rect*.txt")):
        folder = os.path.dirname(truth)
        name = os.path.basename(folder) + os.path.basename(truth)[len("groundtruth_rect"):-len(".txt")].replace(".", "-")
        true = boxes(truth)
        os.makedirs(f"{args.out}/truth", exist_ok=True)
        np.savetxt(f"{args.out}/truth/{name}.txt", true, "%g", ",")
        coarse = (true - [1, 1, 0, 0]) / side + [1, 1, 0, 0]
        coarse[0, 2:] = np.maximum(coarse[0, 2:], 2)  # the smallest first box that foveate takes
        for kind, rows in (("coarse", coarse), ("rare", true[:: args.share])):
            os.makedirs(f"{args.out}/{kind}/{name}/img", exist_ok=True)
            np.savetxt(f"{args.out}/{kind}/{name}/groundtruth_rect.txt", rows, "%.3f", ",")
        for i, picture in zip(range(len(true)), pictures(folder)):
            height, width = (max(1, length // side) for length in picture.shape[:2])
            small = cv2.resize(picture[: height * side, : width * side], (width, height), interpolation=cv2.INTER_AREA)
            cv2.imwrite(f"{args.out}/coarse/{name}/img/{i + 1:04d}.png", small)
            if i % args.share == 0:
                cv2.imwrite(f"{args.out}/rare/{name}/img/{i // args.share + 1:04d}.jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 98])


def overlaps(found, true):
    corner = np.minimum(found[:, :2] + found[:, 2:], true[:, :2] + true[:, 2:]) - np.maximum(found[:, :2], true[:, :2])
    both = np.prod(np.maximum(corner, 0), 1)
    return both / (np.prod(found[:, 2:], 1) + np.prod(true[:, 2:], 1) - both)


def auc(overlap):
    return np.mean([(overlap > threshold).mean() for threshold in np.linspace(0, 1, 21)])


def between(found, frames, share):
    """The boxes of all frames from those of every share-th one."""
    out = np.empty((frames, 4))
    for i in range(frames):
        last, on = divmod(i, share)
        step = (found[last] - found[last - 1]) / share if last else np.zeros(4)
        out[i] = found[last] + on * step * [1, 1, 0, 0]
    return out


def scores(args):
    base, *_ = args.folders
    results = {}
    for folder in args.folders[1:]:
        rows = {}
        for path in sorted(glob.glob(f"{base}/truth/*.txt")):
            name = os.path.basename(path)
            true = boxes(path)
            if not os.path.exists(f"{folder}/foveate/{name}"):
                continue
            found = boxes(f"{folder}/foveate/{name}")
            if len(found) == -(-len(true) // args.share) < len(true):
                found = between(found, len(true), args.share)
            elif "coarse" in os.path.basename(os.path.normpath(folder)):
                found = (found - [1, 1, 0, 0]) * round(args.share ** 0.5) + [1, 1, 0, 0]
            seen = ~np.isnan(true).any(1) & (true[:, 2:] > 0).all(1)
            overlap = overlaps(found[seen], true[seen])
            rows[name] = auc(overlap), 100 * (overlap == 0).mean()
        results[folder] = rows
    names = sorted(set.intersection(*map(set, results.values())))
    first, random = np.array([results[args.folders[1]][name][0] for name in names]), np.random.default_rng(1)
    print(f"{len(names)} sequences")
    for folder, rows in results.items():
        mean = np.mean([rows[name] for name in names], 0)
        gain = first - [rows[name][0] for name in names]
        means = gain[random.integers(0, len(gain), (10000, len(gain)))].mean(1)
        low, high = np.quantile(means, [0.025, 0.975])
        print(f"{folder}: AUC {mean[0]:.3f}, failure {mean[1]:.1f} %; first minus this {gain.mean():+.3f} [{low:+.3f}, {high:+.3f}]")


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--share", type=int, default=16, help="one of so many pixels, or pictures; a square")
    steps = args.add_subparsers(required=True)
    make = steps.add_parser("copies")
    make.add_argument("--seqs", nargs="+", required=True, help="folders of sequences")
    make.add_argument("--out", required=True)
    make.set_defaults(step=copies)
    judge = steps.add_parser("scores")
    judge.add_argument("folders", nargs="+", help="the folder of the copies, then folders of foveate eval, the first of the sensor")
    judge.set_defaults(step=scores)
    args = args.parse_args()
    args.step(args)


if __name__ == "__main__":
    main()
