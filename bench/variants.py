#!/usr/bin/env python3
"""Makes variants of the test sequences, to test settings on videos they were not chosen on.

Usage:
  bench/variants.py --data data --out out-variants
  foveate eval --seqs out-variants/backwards --seeds 3      # also: every2, every3, later, walkers

Input: DATA/tracking and DATA/tracking-wide (OTB layout), and DATA/mot (MOTChallenge layout). Output, in OTB layout, with links to the images:
  backwards  each sequence from its last frame to its first
  every2     every second frame of each sequence: everything moves twice as fast; every3 every third
  later      each sequence from its first quarter on, and from its middle on: another first frame, another template
  larger     (with --redrawn, needs OpenCV) each sequence three times as large, twice where it would be more than 1100 pixels high
  noisy      (with --redrawn) each half as bright, with noise of 10 grey levels, as JPEG of quality 60
  walkers    every target of DATA/mot, one sequence each, from the first frame on in which nobody else's box overlaps a quarter of it, nor
             in the four frames after: a first box that shows somebody else names nobody. Forty frames or more of its longest run
"""
import argparse
import glob
import os
import re


def link(picture, stem):
    to = stem + os.path.splitext(picture)[1]
    if not os.path.lexists(to):
        os.symlink(os.path.abspath(picture), to)


def write(folder, pictures, boxes, make=link):
    """A sequence of these pictures, each put by make(picture, path without extension)."""
    os.makedirs(os.path.join(folder, "img"), exist_ok=True)
    for i, picture in enumerate(pictures, 1):
        make(picture, os.path.join(folder, "img", f"{i:04d}"))
    with open(os.path.join(folder, "groundtruth_rect.txt"), "w") as file:
        file.write("\n".join(boxes) + "\n")


def write_noisy(folder, pictures, boxes):
    import cv2
    import numpy
    random = numpy.random.default_rng(1)

    def make(picture, stem):
        image = cv2.imread(picture)
        image = (0.5 * image + random.normal(0, 10, image.shape)).clip(0, 255).astype("uint8")
        cv2.imwrite(stem + ".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 60])
    write(folder, pictures, boxes, make)


def write_larger(folder, pictures, boxes):
    import cv2
    factor = 3 if 3 * cv2.imread(pictures[0]).shape[0] <= 1100 else 2

    def make(picture, stem):
        image = cv2.resize(cv2.imread(picture), None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(stem + ".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])

    def larger(box):
        x, y, w, h = (float(v) for v in re.split(r"[,\s]+", box))
        # Counted from 1; the middle of a pixel stays the middle of its pixels.
        left, top = (factor * (v - 0.5) + 0.5 for v in (x, y))
        return f"{left:g},{top:g},{factor * w:g},{factor * h:g}"
    write(folder, pictures, [larger(box) for box in boxes], make)


def longest_run(frames):
    best = run = []
    for frame in sorted(frames):
        run = run + [frame] if run and frame == run[-1] + 1 else [frame]
        best = max(best, run, key=len)
    return best


def overlapped(box, others):
    """The largest share of a box that another one overlaps."""
    x, y, w, h = box
    shares = [max(min(x + w, a + c) - max(x, a), 0) * max(min(y + h, b + d) - max(y, b), 0) for a, b, c, d in others]
    return max(shares, default=0) / (w * h)


def from_where_it_is_alone(run, boxes, targets):
    """The frames of a run from the first of five on in which nobody else's box overlaps a quarter of the target's."""
    def alone(frame):
        others = [other[frame] for other in targets.values() if other is not boxes and frame in other]
        return overlapped(boxes[frame], others) < 0.25
    clear = [alone(frame) for frame in run]
    return next((run[i:] for i in range(len(run) - 4) if all(clear[i:i + 5])), [])


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--data", default="data", help="folder with tracking/, tracking-wide/ and mot/; what is not there is left out")
    args.add_argument("--out", default="out-variants", help="folder for the variants")
    args.add_argument("--redrawn", action="store_true", help="make larger/ and noisy/, too: 1.2 GB")
    args = args.parse_args()
    for truth in sorted(glob.glob(f"{args.data}/tracking*/*/groundtruth_rect*.txt")):
        folder = os.path.dirname(truth)
        name = os.path.basename(folder) + os.path.basename(truth)[len("groundtruth_rect"):-len(".txt")].replace(".", "-")
        pictures = sorted(glob.glob(f"{folder}/img/*"))
        boxes = [line.strip() for line in open(truth) if line.strip()]
        n = min(len(pictures), len(boxes))
        write(f"{args.out}/backwards/{name}", pictures[:n][::-1], boxes[:n][::-1])
        if args.redrawn:
            write_larger(f"{args.out}/larger/{name}", pictures[:n], boxes[:n])
            write_noisy(f"{args.out}/noisy/{name}", pictures[:n], boxes[:n])
        for step in (2, 3):
            write(f"{args.out}/every{step}/{name}", pictures[:n:step], boxes[:n:step])
        for quarters in (1, 2):
            start = n * quarters // 4
            write(f"{args.out}/later/{name}-from-{start + 1}", pictures[start:n], boxes[start:n])
    for truth in sorted(glob.glob(f"{args.data}/mot/*/gt/gt.txt")):
        folder = os.path.dirname(os.path.dirname(truth))
        pictures = sorted(glob.glob(f"{folder}/img1/*"))
        targets = {}
        for row in (line.split(",") for line in open(truth) if line.strip()):
            targets.setdefault(int(row[1]), {})[int(row[0])] = [float(v) for v in row[2:6]]
        for target, boxes in targets.items():
            run = [frame for frame in longest_run(boxes) if frame <= len(pictures)]
            run = from_where_it_is_alone(run, boxes, targets)
            if len(run) >= 40:
                name = f"{os.path.basename(folder)}-{target}"
                write(f"{args.out}/walkers/{name}", [pictures[f - 1] for f in run], [",".join(f"{v:g}" for v in boxes[f]) for f in run])


if __name__ == "__main__":
    main()
