#!/usr/bin/env python3
"""Makes variants of the test sequences, to test settings on videos they were not chosen on.

Usage:
  bench/variants.py --data data --out out-variants
  foveate eval --seqs out-variants/backwards --seeds 3      # also: longer, every2, every3, later, walkers

Input: DATA/tracking and DATA/tracking-wide (OTB layout), and DATA/mot (MOTChallenge layout). Output, in OTB layout, with links to the images:
  backwards  each sequence from its last frame to its first
  longer     each sequence forwards and backwards, twice: four times as long
  every2     every second frame of each sequence: everything moves twice as fast; every3 every third
  later      each sequence from its first quarter on, and from its middle on: another first frame, another template
  sloppy     (with --redrawn) each with a first box as a hand may draw it: shifted by 8 % and of other sides by 10 % (standard deviations)
  larger     (with --redrawn) each sequence three times as large, twice where it would be more than 1100 pixels high
  noisy      (with --redrawn) each half as bright, with noise of 10 grey levels, as JPEG of quality 60
  grey       (with --redrawn) each without colour
  shaken     (with --redrawn) each through a window that shakes: 2 % of the shorter side, at most 8 %
  covered    (with --redrawn) each with half of the target hidden for 25 of every 75 frames, from one side after the other, by another
             part of the picture
  thrown     (with --redrawn) not from DATA: drawn balls, at rest and then thrown. Nobody drew their boxes by hand: the truth is exact
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
        x, y, w, h = numbers(box)
        # Counted from 1; the middle of a pixel stays the middle of its pixels.
        left, top = (factor * (v - 0.5) + 0.5 for v in (x, y))
        return text((left, top, factor * w, factor * h))
    write(folder, pictures, [larger(box) for box in boxes], make)


def numbers(box):
    return [float(v) for v in re.split(r"[,\s]+", box)]


def text(box):
    return ",".join(f"{v:g}" for v in box)


def write_sloppy(folder, pictures, boxes):
    import cv2
    import numpy
    random = numpy.random.default_rng(len(pictures))
    (x, y, w, h), (height, width) = numbers(boxes[0]), cv2.imread(pictures[0]).shape[:2]
    cx, cy = (x + w / 2 + w * random.normal(0, 0.08), y + h / 2 + h * random.normal(0, 0.08))
    w, h = (side * numpy.exp(random.normal(0, 0.1)) for side in (w, h))
    left, top = max(cx - w / 2, 1), max(cy - h / 2, 1)
    first = left, top, min(w, width + 1 - left), min(h, height + 1 - top)
    write(folder, pictures, [text(round(v, 1) for v in first)] + boxes[1:])


def write_grey(folder, pictures, boxes):
    import cv2
    write(folder, pictures, boxes, lambda picture, stem: jpeg(stem, cv2.imread(picture, cv2.IMREAD_GRAYSCALE)))


def write_shaken(folder, pictures, boxes):
    import cv2
    import numpy
    random, side = numpy.random.default_rng(len(pictures)), min(cv2.imread(pictures[0]).shape[:2])
    most, shake, shifts = int(0.08 * side), numpy.zeros(2), []
    for i in range(len(pictures)):
        shifts.append(numpy.clip(numpy.round(shake), -most, most).astype(int))
        shake = 0.7 * shake + random.normal(0, 0.015 * side, 2)

    def make(picture, stem):
        (dx, dy), image = shifts[int(os.path.basename(stem)) - 1], cv2.imread(picture)
        jpeg(stem, image[most + dy:len(image) - most + dy, most + dx:image.shape[1] - most + dx])

    def shifted(box, shift):
        x, y, w, h = numbers(box)
        return text((x - most - shift[0], y - most - shift[1], w, h))
    write(folder, pictures, [shifted(box, shift) for box, shift in zip(boxes, shifts)], make)


def write_covered(folder, pictures, boxes):
    import cv2
    import numpy
    random, patch = numpy.random.default_rng(len(pictures)), None

    def make(picture, stem):
        nonlocal patch
        image = cv2.imread(picture)
        i = int(os.path.basename(stem)) - 1
        turn, since = divmod(i - 29, 75)
        x, y, w, h = numbers(boxes[i])
        if i >= 29 and since < 25 and numpy.isfinite((x, y, w, h)).all():
            (height, width), (tall, wide) = image.shape[:2], (max(int(1.3 * h), 2), max(int(1.3 * w), 2))
            if since == 0 or patch is None:
                top, left = random.integers(0, max(height - tall, 1)), random.integers(0, max(width - wide, 1))
                patch = image[top:top + tall, left:left + wide].copy()
            # Half of the box after eight frames, and a seventh of it beyond its other edges.
            share = 0.5 * min(1, (since + 1) / 8, (25 - since) / 8)
            left, top, right, bottom = x - 1 - 0.15 * w, y - 1 - 0.15 * h, x - 1 + 1.15 * w, y - 1 + 1.15 * h
            left, top, right, bottom = [
                (left, top, x - 1 + share * w, bottom), (left, y - 1 + (1 - share) * h, right, bottom),
                (x - 1 + (1 - share) * w, top, right, bottom), (left, top, right, y - 1 + share * h),
            ][turn % 4]
            left, top = max(round(left), 0), max(round(top), 0)
            right, bottom = min(round(right), width), min(round(bottom), height)
            if right > left and bottom > top:
                image[top:bottom, left:right] = cv2.resize(patch, (right - left, bottom - top))
        jpeg(stem, image)
    write(folder, pictures, boxes, make)


def jpeg(stem, image):
    import cv2
    cv2.imwrite(stem + ".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])


def write_thrown(folder, seed):
    import cv2
    import numpy
    random, (height, width) = numpy.random.default_rng(seed), (360, 480)
    radius, colour, gravity = random.uniform(8, 20), random.uniform(20, 230, 3), [0.02, 0.07, 0.3, 1.1][seed // 2 % 4]
    wall = random.uniform(60, 220, 3) + 5 * cv2.GaussianBlur(random.normal(0, 25, (height, width, 3)), (0, 0), 25)

    def at(t):
        """The middle after t frames of flight, pixels; the middle of the first pixel is 0."""
        return start + speed * max(t, 0) + [0, 0.5 * gravity * max(t, 0) ** 2]

    def draw(image, x, y):
        top, left = (max(int(v - radius) - 2, 0) for v in (y, x))
        part = image[top:top + int(2 * radius) + 5, left:left + int(2 * radius) + 5]
        down, across = numpy.mgrid[:part.shape[0], :part.shape[1]]
        down, across = down + top - y, across + left - x
        light = 60 * (numpy.hypot(across + 0.4 * radius, down + 0.4 * radius) < 0.4 * radius)
        alpha = (radius - numpy.hypot(across, down) + 0.5).clip(0, 1)[..., None] / 4
        part += alpha * (colour + light[..., None] - wall[top:top + len(part), left:left + part.shape[1]])
    flies = seed % 2
    start = numpy.array([random.uniform(60, 420), random.uniform(40, 80)]) if not flies else numpy.array([60.0, 300.0])
    speed = numpy.array([20.0, -22.0]) * gravity ** 0.5 * flies
    middles = [at(t) for t in range(-15, 60)]
    out = [not (radius < x < width - radius and radius < y < height - radius) for x, y in middles]
    middles = middles[:out.index(True) if any(out) else None]

    def make(index, stem):
        image = wall + random.normal(0, 2.5, wall.shape)
        for shift in (-0.09, -0.03, 0.03, 0.09):
            draw(image, *at(index - 15 + shift))
        jpeg(stem, image.clip(0, 255).astype("uint8"))
    # From the left edge of the first pixel, which counts as 1.
    boxes = [text((round(x - radius + 1.5, 3), round(y - radius + 1.5, 3), 2 * radius, 2 * radius)) for x, y in middles]
    write(folder, range(len(boxes)), boxes, make)


REDRAWN = {"larger": write_larger, "noisy": write_noisy, "sloppy": write_sloppy, "grey": write_grey, "shaken": write_shaken, "covered": write_covered}


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
    """The frames of a run from the first of five on in which no other box overlaps a quarter of the target's."""
    def alone(frame):
        others = [other[frame] for other in targets.values() if other is not boxes and frame in other]
        return overlapped(boxes[frame], others) < 0.25
    clear = [alone(frame) for frame in run]
    return next((run[i:] for i in range(len(run) - 4) if all(clear[i:i + 5])), [])


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--data", default="data", help="folder with tracking/, tracking-wide/ and mot/; what is not there is left out")
    args.add_argument("--out", default="out-variants", help="folder for the variants")
    args.add_argument("--redrawn", action="store_true", help="make those marked so, too, which needs OpenCV: 2.2 GB")
    args = args.parse_args()
    truths = [glob.glob(f"{args.data}/{sequences}/*/groundtruth_rect*.txt") for sequences in ("tracking", "tracking-wide")]
    for truth in sorted(sum(truths, [])):
        folder = os.path.dirname(truth)
        name = os.path.basename(folder) + os.path.basename(truth)[len("groundtruth_rect"):-len(".txt")].replace(".", "-")
        pictures = sorted(glob.glob(f"{folder}/img/*"))
        boxes = [line.strip() for line in open(truth) if line.strip()]
        n = min(len(pictures), len(boxes))
        write(f"{args.out}/backwards/{name}", pictures[:n][::-1], boxes[:n][::-1])
        for kind, make in REDRAWN.items() if args.redrawn else ():
            make(f"{args.out}/{kind}/{name}", pictures[:n], boxes[:n])
        there_and_back = [*range(n), *range(n - 2, -1, -1)]
        longer = there_and_back + there_and_back[1:]
        write(f"{args.out}/longer/{name}", [pictures[i] for i in longer], [boxes[i] for i in longer])
        for step in (2, 3):
            write(f"{args.out}/every{step}/{name}", pictures[:n:step], boxes[:n:step])
        for quarters in (1, 2):
            start = n * quarters // 4
            write(f"{args.out}/later/{name}-from-{start + 1}", pictures[start:n], boxes[start:n])
    for seed in range(64) if args.redrawn else ():
        write_thrown(f"{args.out}/thrown/thrown-{seed:02}", seed)
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
                write(f"{args.out}/walkers/{name}", [pictures[f - 1] for f in run], [text(boxes[f]) for f in run])


if __name__ == "__main__":
    main()
