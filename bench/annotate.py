#!/usr/bin/env python3
"""Clicks for boxes of a stated quality: `foveate annotate` beside a straight line and beside CSRT, on sequences with ground truth.

    foveate eval --seqs data/tracking data/tracking-wide data/tracking-train --out out-eval   # scores.json: the halves of the sources
    bench/annotate.py clicks target/release/foveate --seqs data/tracking ... --halves out-eval/scores.json --out out-annotate
    bench/annotate.py fit --seqs data/tracking ... --halves out-eval/scores.json

`clicks` counts key frames until the mean IoU of all frames is 0.8, and until no frame is below 0.5. A key frame is a true box. Evenly
spaced key frames: 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, ... of them. Checked first: two key frames, the first and the last box,
then the first frame of check.csv in each round. Each sequence is annotated with the weights of the other half.

`fit` needs the Python package. It tracks from five key frames of each sequence, forwards and backwards, and prints the coefficients of
crates/foveate-cli/src/cmd/annotate/join.rs, and those of each half, tested on the other.
"""
import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np

COUNTS = [2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 130, 160, 200, 300, 500, 1000, 2000]
MEAN, LEAST = 0.8, 0.5
METHODS = ("straight", "csrt", "even", "checked")


def read_truth(path):
    rows = []
    for line in open(path):
        if line.strip():
            row = [float(x) for x in line.replace("\t", ",").replace(" ", ",").split(",") if x]
            good = len(row) == 4 and np.isfinite(row).all() and row[2] > 0 and row[3] > 0
            rows.append(row if good else [np.nan] * 4)
    return np.array(rows)


def sequences(folders):
    for folder in folders:
        for path in sorted(Path(folder).iterdir()):
            for truth in sorted(path.glob("groundtruth_rect*.txt")):
                number = truth.stem.removeprefix("groundtruth_rect").strip(".")
                name = path.name if number in ("", "1") else f"{path.name}-{number}"
                source = path / "video.mp4" if (path / "video.mp4").exists() else path
                yield name, source, read_truth(truth)


def iou(a, b):
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    side = np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    inter = np.maximum(side, 0).prod(1)
    return inter / (a[:, 2:].prod(1) + b[:, 2:].prod(1) - inter)


def overlaps(boxes, truth):
    """IoU in the frames with a true box; a missing box has 0."""
    seen = np.isfinite(truth[:, 0])
    boxes = np.where(np.isfinite(boxes), boxes, 1e9)
    return iou(boxes[seen], truth[seen])


def straight(truth, keys):
    return np.stack([np.interp(np.arange(len(truth)), keys, truth[keys, k]) for k in range(4)], 1)


class Csrt:
    """OpenCV's CSRT from each key frame, forwards and backwards; each frame has the box of the nearer key frame."""

    def __init__(self, source, truth):
        import cv2

        cv2.setNumThreads(1)
        self.create, self.pictures, self.bad = cv2.TrackerCSRT_create, pictures_of(source), 0
        self.truth = truth[: len(self.pictures)]

    def follow(self, boxes, key, step, count, strict):
        """Tracks `count` frames. Returns False, with `strict`, at the first box below LEAST."""
        if count == 0:
            return True
        tracker = self.create()
        x, y, w, h = (int(v) for v in np.round(self.truth[key] - [1, 1, 0, 0]))
        tracker.init(self.pictures[key], (x, y, max(w, 2), max(h, 2)))
        for t in range(key + step, key + step * (count + 1), step):
            found, box = tracker.update(self.pictures[t])
            boxes[t] = [box[0] + 1, box[1] + 1, box[2], box[3]] if found else np.nan
            if strict and np.isfinite(self.truth[t, 0]) and not overlaps(boxes[t : t + 1], self.truth[t : t + 1])[0] >= LEAST:
                self.bad = t
                return False
        return True

    def __call__(self, keys, strict=False):
        """Boxes of all frames; with `strict` only those up to the first one below LEAST, from the last place of such a box on."""
        boxes = np.full_like(self.truth, np.nan)
        boxes[keys] = self.truth[keys]
        for a, b in sorted(zip(keys, keys[1:]), key=lambda ends: abs(sum(ends) / 2 - self.bad)):
            if not (self.follow(boxes, a, 1, (b - a) // 2, strict) and self.follow(boxes, b, -1, (b - a - 1) // 2, strict)):
                break
        return boxes


def pictures_of(source):
    import cv2

    files = sorted((source / "img").iterdir()) if source.is_dir() else []
    if files:
        return [cv2.imread(str(file)) for file in files]
    video, pictures = cv2.VideoCapture(str(source)), []
    while (read := video.read())[0]:
        pictures.append(read[1])
    return pictures


class Foveate:
    def __init__(self, args, name, source, truth, half):
        other = {"a": "b", "b": "a"}[half]
        self.command = [args.program, "annotate", source, "--format", "otb", "--threads", "1"]
        for setting in args.set:
            self.command += ["--set", setting.replace("{other}", other)]
        self.out, self.truth = Path(args.out) / name, truth

    def __call__(self, keys):
        self.out.mkdir(parents=True, exist_ok=True)
        rows = ["NaN,NaN,NaN,NaN"] * len(self.truth)
        for key in keys:
            rows[key] = ",".join(str(x) for x in self.truth[key])
        file = self.out / "keys.txt"
        file.write_text("\n".join(rows) + "\n")
        out = self.out / "boxes"
        run = subprocess.run([*self.command, "--keyframes", file, "--out", out], capture_output=True, text=True)
        if run.returncode:
            sys.exit(run.stderr)
        boxes = np.array([[float(x) for x in line.split(",")] for line in open(out / "boxes.txt")])
        full = np.full_like(self.truth, np.nan)
        n = min(len(full), len(boxes))
        full[:n] = boxes[:n]
        # Video.mp4 may have fewer frames than the truth has lines, never more.
        return full, [int(row["frame"]) - 1 for row in csv.DictReader(open(out / "check.csv"))]


def evenly(frames, count):
    return sorted({int(frames[round(i * (len(frames) - 1) / (count - 1))]) for i in range(count)})


def counted(boxes_of, truth):
    """Key frames, evenly spaced, until the mean is good and until the worst is. `boxes_of` may stop at a bad box once the mean is good."""
    frames = np.flatnonzero(np.isfinite(truth[:, 0]))
    mean = least = None
    for count in COUNTS:
        keys = evenly(frames, min(count, len(frames)))
        ious = overlaps(boxes_of(keys, mean is not None), truth)
        mean = len(keys) if mean is None and ious.mean() >= MEAN else mean
        least = len(keys) if least is None and ious.min() >= LEAST else least
        if (mean and least) or len(keys) == len(frames):
            break
    return mean or len(frames), least or len(frames)


def checked(annotate, truth, most=60):
    frames = np.flatnonzero(np.isfinite(truth[:, 0]))
    keys, mean, least = [int(frames[0]), int(frames[-1])], None, None
    while len(keys) < min(most, len(frames)):
        boxes, check = annotate(sorted(keys))
        ious = overlaps(boxes, truth)
        mean = len(keys) if mean is None and ious.mean() >= MEAN else mean
        least = len(keys) if least is None and ious.min() >= LEAST else least
        if mean and least:
            break
        known = set(frames.tolist()) - set(keys)
        # Where the target is hidden a person has nothing to draw.
        keys.append(next((t for t in check if t in known), None) or max(known))
    return mean or len(keys), least or len(keys)


def clicks(args):
    halves = {s["sequence"]: s["half"] for s in json.load(open(args.halves))["sources"]} if args.halves else {}
    Path(args.out).mkdir(parents=True, exist_ok=True)
    table = Path(args.out) / "clicks.csv"
    rows = {row["sequence"]: row for row in csv.DictReader(open(table))} if table.exists() else {}
    for name, source, truth in sequences(args.seqs):
        row = rows.setdefault(name, {"sequence": name, "frames": int(np.isfinite(truth[:, 0]).sum())})
        for method in (method for method in args.methods if not row.get(f"{method} least")):
            if method == "csrt":
                trackers = Csrt(source, truth)
                count = counted(trackers, trackers.truth)
            elif method == "straight":
                count = counted(lambda keys, _: straight(truth, keys), truth)
            else:
                annotate = Foveate(args, name, source, truth, halves[name])
                count = counted(lambda keys, _: annotate(keys)[0], truth) if method == "even" else checked(annotate, truth)
            row[f"{method} mean"], row[f"{method} least"] = count
        with open(table, "w", newline="") as file:
            writer = csv.DictWriter(file, dict.fromkeys(key for row in rows.values() for key in row))
            writer.writeheader()
            writer.writerows(rows.values())
        print(row, flush=True)
    for what in ("mean", "least"):
        print(f"key frames until {what}: total, median a sequence")
        for method in METHODS:
            values = [int(row[f"{method} {what}"]) for row in rows.values() if row.get(f"{method} {what}")]
            if values:
                print(f"  {method:9} {sum(values):6} {statistics.median(values):6.1f}  of {len(values)} sequences")


def logit(p):
    p = np.clip(p, 0.001, 0.999)
    return np.log(p / (1 - p))


def fit(args):
    import foveate

    foveate.set_threads(1)
    halves = {s["sequence"]: s["half"] for s in json.load(open(args.halves))["sources"]}
    pairs, alone = [], []
    for name, source, truth in sequences(args.seqs):
        other = {"a": "b", "b": "a"}[halves[name]]
        settings = dict(setting.replace("{other}", other).split("=", 1) for setting in args.set)
        pictures = [np.array(picture) for picture in foveate.Video(source)]
        truth = truth[: len(pictures)]
        keys = evenly(np.flatnonzero(np.isfinite(truth[:, 0])), 5)
        tracks = {}
        for key in keys:
            for way, end in ((1, keys[-1]), (-1, keys[0])):
                tracker, rows = foveate.Tracker(config={**settings}), {}
                tracker.init(pictures[key], tuple(truth[key] - [1, 1, 0, 0]))
                for t in range(key + way, end + way, way):
                    seen = tracker.update(pictures[t])
                    rows[t] = [*(np.array(seen.box) + [1, 1, 0, 0]), seen.p_lost]
                tracks[key, way] = rows
                alone += [(halves[name], [1, logit(r[4])], iou(r[:4], truth[t])[0]) for t, r in rows.items() if np.isfinite(truth[t, 0])]
        for step in (1, 2, 4):
            for a, b in zip(keys[::step], keys[step::step]):
                forward, backward = tracks[a, 1], tracks[b, -1]
                ends = [iou(forward[b][:4], truth[b])[0], iou(backward[a][:4], truth[a])[0]]
                for t in range(a + 1, b):
                    if not np.isfinite(truth[t, 0]):
                        continue
                    both = iou(forward[t][:4], backward[t][:4])[0]
                    for row, far, end in ((forward[t], (t - a) / (b - a), ends[0]), (backward[t], (b - t) / (b - a), ends[1])):
                        pairs.append((halves[name], [1, logit(row[4]), both, far * (1 - end)], iou(row[:4], truth[t])[0]))
        print(name, flush=True)
    for what, data in (("BOTH", pairs), ("ALONE", alone)):
        half, x, y = (np.array([row[k] for row in data]) for k in range(3))
        solve = lambda m: np.linalg.lstsq(x[m], y[m], rcond=None)[0]
        print(what, np.round(solve(np.ones(len(y), bool)), 3))
        for h in "ab":
            w = solve(half == h)
            print(f"  of half {h}", np.round(w, 3), "error on the other", round(float(np.sqrt(np.mean((x[half != h] @ w - y[half != h]) ** 2))), 4))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["clicks", "fit"])
    parser.add_argument("program", nargs="?", default="target/release/foveate")
    parser.add_argument("--seqs", nargs="+", required=True)
    parser.add_argument("--halves", help="scores.json of foveate eval")
    parser.add_argument("--set", action="append", default=[], help="setting of the configuration; {other} is the other half")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=["straight", "even", "checked"])
    parser.add_argument("--out", default="out-annotate")
    args = parser.parse_args()
    if not args.halves and (args.what == "fit" or {"even", "checked"} & set(args.methods)):
        parser.error("foveate needs --halves, because each sequence is annotated with the weights of the other half")
    args.program = os.path.abspath(args.program)
    {"clicks": clicks, "fit": fit}[args.what](args)


if __name__ == "__main__":
    main()
