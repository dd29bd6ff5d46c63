#!/usr/bin/env python3
"""Detects, tracks and classifies the players of hockey.mp4, and compares with hand labels (README.md beside this file).

Usage:
  pip install opencv-contrib-python-headless
  bench/hockey/run.py target/release/foveate data/clips/hockey.mp4 --out out-hockey [--seeds 10]

Judged on every 25th frame alone. `Found`: foveate's detectors, and OpenCV's detector of people (HOG and a linear SVM), by
themselves and with tracks. `Followed`: the first labelled box of each person in each shot is given, and that frame is not
judged; foveate by several gaze policies, OpenCV's trackers, and the first box kept still. `Told apart`: recognisers learned
from the dozen boxes of boxes.txt name what `Followed` holds; by one frame alone, by the last three and by all. `Every frame`
takes each track that is not lost for the person that it was begun on, so that more than the labelled frames count.

HOTA, IDF1 and MOTA are those of `foveate eval --mot`. Recall, precision and teams match boxes one to one, the largest
overlap first. Prints the tables; OUT/scores.json has every run. Finished runs are kept and not done again.
"""
import argparse
import collections
import csv
import json
import os
import shutil
import statistics
import subprocess
import sys

import cv2

HERE = os.path.dirname(os.path.abspath(__file__))
TEAMS = {1: "attacker", 2: "goalkeeper", 3: "umpire"}
# First frame of each shot, and one after the last.
SHOTS = [1, 86, 220, 341]
JUDGED = range(1, 341, 25)
DETECTORS = ["motion", "walkers", "flow", "saliency"]
POLICIES = ["fixed", "random", "hedge", "gp-ucb", "pool"]
OVERLAPS = (0.3, 0.5)


def read(path):
    """Lines of MOTChallenge's text: (frame, id, x, y, w, h, the rest), pixels from 1."""
    with open(path) as file:
        rows = [[float(v) for v in line.split(",")] for line in file if line.strip()]
    return [(int(r[0]), int(r[1]), r[2:6], r[6:]) for r in rows]


def write(path, rows):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w") as file:
        for frame, name, (x, y, w, h), rest in rows:
            tail = ",".join(f"{v:g}" for v in (rest or [1, -1, -1, -1]))
            file.write(f"{frame},{name},{x:.2f},{y:.2f},{w:.2f},{h:.2f},{tail}\n")


def is_finished(out):
    """Whether a folder has a run that was not stopped."""
    try:
        with open(f"{out}/run.json") as file:
            return json.load(file).get("ended") == "finished"
    except FileNotFoundError:
        return False


def shot(frame):
    return sum(frame >= first for first in SHOTS) - 1


def iou(a, b):
    side = [max(0.0, min(a[i] + a[i + 2], b[i] + b[i + 2]) - max(a[i], b[i])) for i in (0, 1)]
    shared = side[0] * side[1]
    return shared / (a[2] * a[3] + b[2] * b[3] - shared)


def matched(truth, found, least):
    """Pairs (row of truth, row found) in the same frame, one to one, largest overlap first."""
    pairs = []
    for frame in JUDGED:
        ours = [(t, r) for t in truth if t[0] == frame for r in found if r[0] == frame]
        taken = set()
        for t, r in sorted(ours, key=lambda p: -iou(p[0][2], p[1][2])):
            if iou(t[2], r[2]) >= least and not {id(t), id(r)} & taken:
                taken |= {id(t), id(r)}
                pairs.append((t, r))
    return pairs


class Bench:
    def __init__(self, args):
        self.args, self.out = args, args.out
        self.truth, self.boxes = read(f"{HERE}/gt.txt"), read(f"{HERE}/boxes.txt")
        self.first = {}
        for row in self.truth:
            self.first.setdefault(row[1], row)
        # Frames with given boxes do not count.
        given = {row[0] for row in self.first.values()}
        self.later = [row for row in self.truth if row[0] not in given]
        os.makedirs(self.out, exist_ok=True)
        write(f"{self.out}/inits.txt", list(self.first.values()))
        self.pictures, video = [], cv2.VideoCapture(args.video)
        while (read_one := video.read())[0]:
            self.pictures.append(read_one[1])
        if len(self.pictures) != SHOTS[-1] - 1:
            sys.exit(f"{args.video}: expected the {SHOTS[-1] - 1} frames of hockey.mp4, found {len(self.pictures)}")
        self.seeds, self.scores = range(1, args.seeds + 1), {}

    def foveate(self, *words):
        done = subprocess.run([self.args.foveate, *map(str, words)], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"foveate {' '.join(map(str, words))}:\n{done.stderr}")
        return done.stdout

    def track(self, name, seed, *words):
        """A run of many targets, whose folder is given back."""
        out = f"{self.out}/runs/{name}/seed-{seed}"
        if not is_finished(out):
            quiet = ["--no-video", "--no-report", "--seed", seed, "--out", out]
            self.foveate("track", self.args.video, *words, *quiet)
        return out

    def score(self, name, seed, rows, truth):
        """Figures of one run, the program's own and ours."""
        frames = {t[0] for t in truth} | ({1} if truth is self.truth else set())
        rows, folder = [r for r in rows if r[0] in frames], f"{self.out}/judged/{name}/seed-{seed}"
        write(f"{folder}/truth/gt.txt", truth)
        write(f"{folder}/result/gt.txt", rows)
        said = self.foveate("eval", "--mot", "--truth", f"{folder}/truth/gt.txt", "--results", f"{folder}/result",
                            "--json", "--out", f"{folder}/eval")
        pooled = json.loads(said)["trackers"][0]["pooled"]
        figures = {key: pooled[key] for key in ("hota", "idf1", "mota", "switches")}
        figures["boxes"] = len(rows) / len(frames)
        for least in OVERLAPS:
            pairs = matched(truth, rows, least)
            figures[f"recall{least}"] = len(pairs) / len(truth)
            figures[f"precision{least}"] = len(pairs) / max(len(rows), 1)
            for n in range(3):
                of = [t for t in truth if shot(t[0]) == n]
                figures[f"shot{n + 1} {least}"] = sum(shot(t[0]) == n for t, _ in pairs) / len(of)
        ids = collections.defaultdict(set)
        held = matched(truth, rows, 0.3)
        for t, r in held:
            ids[t[1]].add(r[1])
        seen = collections.Counter(t[1] for t, _ in held)
        whole = collections.Counter(t[1] for t in truth)
        figures["kept"] = sum(len(ids[i]) == 1 and seen[i] == whole[i] for i in whole)
        self.scores.setdefault(name, []).append({"seed": seed, **figures})

    def mean(self, name, key, digits=2):
        values = [run[key] for run in self.scores[name]]
        text = f"{statistics.mean(values):.{digits}f}"
        if max(values) - min(values) > 0.5 * 10**-digits:
            text += f" ({min(values):.{digits}f} to {max(values):.{digits}f})"
        return text

    def table(self, title, names, columns):
        print(f"\n{title}\n\n| | {' | '.join(columns)} |\n|{' --- |' * (len(columns) + 1)}")
        for name in names:
            cells = [self.mean(name, key, 1 if key in ("boxes", "kept", "switches") else 2) for key in columns.values()]
            print(f"| {name} | {' | '.join(cells)} |")

    # Found.

    def hog(self):
        path = f"{self.out}/hog.txt"
        if not os.path.exists(path):
            hog, rows = cv2.HOGDescriptor(), []
            hog.setSVMDetector(cv2.HOGDescriptor_getDefaultPeopleDetector())
            for frame, picture in enumerate(self.pictures, 1):
                boxes, weights = hog.detectMultiScale(picture, winStride=(8, 8), padding=(8, 8), scale=1.05)
                for (x, y, w, h), weight in zip(boxes, weights):
                    # Its window has a margin around the person, taken off as OpenCV's own example does.
                    box = [x + 0.1 * w + 1, y + 0.07 * h + 1, 0.8 * w, 0.8 * h]
                    rows.append((frame, -1, box, [float(weight), -1, -1, -1]))
            write(path, rows)
        return path

    def found(self):
        alone, tracks = [], []
        for kind in [*DETECTORS, "hog"]:
            boxes = f"{self.out}/{kind}.txt"
            words = ["--detections", self.hog()] if kind == "hog" else ["--detect", kind]
            for seed in self.seeds:
                save = ["--save-detections", boxes] if kind != "hog" and not os.path.exists(boxes) else []
                run = self.track(f"found-{kind}", seed, *words, *save)
                self.score(f"{kind}, tracks", seed, read(f"{run}/tracks.txt"), self.truth)
            detections = [(r[0], n, r[2], r[3]) for n, r in enumerate(read(boxes), 1)]
            self.score(f"{kind}, boxes", 1, detections, self.truth)
            alone.append(f"{kind}, boxes")
            tracks.append(f"{kind}, tracks")
        columns = {"boxes a frame": "boxes"}
        for least in OVERLAPS:
            columns |= {f"recall at {least}": f"recall{least}", f"precision at {least}": f"precision{least}"}
        columns |= {f"shot {n} at 0.3": f"shot{n} 0.3" for n in (1, 2, 3)}
        self.table("Found", alone + tracks, columns)
        self.table("Found and followed", tracks, {"HOTA": "hota", "IDF1": "idf1", "MOTA": "mota", "kept, of 5": "kept"})

    # Followed.

    def by_hand(self, make):
        """Tracks of a tracker of OpenCV, or of the first box where there is none."""
        rows = []
        for name, (frame, _, box, _) in self.first.items():
            tracker = make and make()
            if tracker:
                cv2.setRNGSeed(1)
                tracker.init(self.pictures[frame - 1], tuple(round(v) for v in (box[0] - 1, box[1] - 1, *box[2:])))
            for later in range(frame + 1, SHOTS[shot(frame) + 1]):
                if tracker:
                    found, (x, y, w, h) = tracker.update(self.pictures[later - 1])
                    box = [x + 1, y + 1, w, h] if found else box
                rows.append((later, name, box, []))
        return rows

    def singly(self, seed):
        """Each target tracked by itself, by `natural`."""
        rows = []
        for name, (frame, _, box, _) in self.first.items():
            out = f"{self.out}/runs/natural-{name}/seed-{seed}"
            if not is_finished(out):
                self.foveate("track", self.args.video, "--from", frame, "--until", SHOTS[shot(frame) + 1] - 1, "--init",
                             ",".join(map(str, box)), "--seed", seed, "--no-video", "--no-report", "--out", out)
            with open(f"{out}/boxes.txt") as file:
                boxes = [[float(v) for v in line.split(",")] for line in file]
            rows += [(frame + n, name, box, []) for n, box in enumerate(boxes)]
        return rows

    def followed(self):
        names = []
        inits = ["--inits", f"{self.out}/inits.txt"]
        for policy in POLICIES:
            names.append(f"multi-boxes, {policy}")
            for seed in self.seeds:
                run = self.track(f"boxes-{policy}", seed, *inits, "--config", "multi-boxes", "--policy", policy)
                self.score(names[-1], seed, read(f"{run}/tracks.txt"), self.later)
        names.append("natural, each alone")
        for seed in self.seeds:
            self.score(names[-1], seed, self.singly(seed), self.later)
        peers = {"first box kept": None, "CSRT": cv2.TrackerCSRT.create, "KCF": cv2.TrackerKCF.create,
                 "MIL": cv2.TrackerMIL.create}
        for name, make in peers.items():
            names.append(name)
            self.score(name, 1, self.by_hand(make), self.later)
        columns = {"HOTA": "hota", "IDF1": "idf1", "MOTA": "mota", "recall at 0.3": "recall0.3", "at 0.5": "recall0.5"}
        columns |= {f"shot {n} at 0.5": f"shot{n} 0.5" for n in (1, 2, 3)} | {"kept, of 5": "kept"}
        self.table("Followed", names, columns)

    # Classes.

    def learn(self, name, shots, config):
        """A recogniser of the boxes of these shots."""
        folder, model = f"{self.out}/teams/{name}", f"{self.out}/teams/{name}.safetensors"
        for frame, _, box, (_, team, *_) in self.boxes:
            if shot(frame) in shots:
                x, y, w, h = (int(v) for v in box)
                os.makedirs(f"{folder}/{TEAMS[team]}", exist_ok=True)
                picture = self.pictures[frame - 1][y - 1:y - 1 + h, x - 1:x - 1 + w]
                cv2.imwrite(f"{folder}/{TEAMS[team]}/{frame:03}.png", picture)
        if not os.path.exists(model):
            self.foveate("train", "classifier", "--data", folder, *config, "--out", model)
        return os.path.abspath(model)

    def teams(self):
        memories = {"one frame": 1.0, "three frames": 3.0, "all frames": None}
        layers = {"k-means, grey (the default)": [], "gradients and colour (natural)": ["--config", "natural"],
                  "cells of grey and colour (teams.toml)": ["--config", f"{HERE}/teams.toml"]}
        samples = {"a dozen boxes": (range(3), range(3)), "eight boxes of shot 2, judged on 1 and 3": ([1], [0, 2])}
        ways = [(f"{n}-{m}", *samples[sample], layers[layer], f"{sample} | {layer}")
                for n, sample in enumerate(samples) for m, layer in enumerate(layers)]
        judges = ("judged", "every")
        heads = [f"{memory}{', every frame' if judge == 'every' else ''}" for judge in judges for memory in memories]
        print(f"\nTold apart\n\n| learned from | first layer | boxes | frames | {' | '.join(heads)} |\n|{' --- |' * 10}")
        team_of = {t[1]: str(int(t[3][1]) - 1) for t in self.truth}
        for name, shots, judged, config, said in ways:
            model = self.learn(name, shots, config)
            for memory, frames in memories.items():
                add = '"sum"' if frames is None else f"{{ forgetting = {{ memory = {frames} }} }}"
                what = f'recogniser={{ kind = "classifier", weights = "{model}", accumulate = {add} }}'
                for seed in self.seeds:
                    words = ["--inits", f"{self.out}/inits.txt", "--config", "multi-boxes", "--set", what]
                    run = self.track(f"{name}-{memory.replace(' ', '-')}", seed, *words)
                    with open(f"{run}/tracks.csv") as file:
                        rows = [r for r in csv.DictReader(file) if r["class"] and r["phase"] != "lost"]
                    seen = {(int(r["frame"]), int(r["id"])): r["class"] for r in rows}
                    truth = [t for t in self.later if shot(t[0]) in judged]
                    pairs = matched(truth, read(f"{run}/tracks.txt"), 0.3)
                    # Classes in the order of their folders' names, as TEAMS has them.
                    of = {"judged": [seen[r[0], r[1]] == team_of[t[1]] for t, r in pairs],
                          "every": [c == team_of[i] for (frame, i), c in seen.items() if shot(frame) in judged]}
                    for judge, right in of.items():
                        self.scores.setdefault(f"teams {name} {memory} {judge}", []).append(
                            {"seed": seed, "right": sum(right) / max(len(right), 1), "n": len(right)})
            cells = [self.mean(f"teams {name} {next(iter(memories))} {judge}", "n", 0) for judge in judges]
            cells += [self.mean(f"teams {name} {memory} {judge}", "right") for judge in judges for memory in memories]
            print(f"| {said} | {' | '.join(cells)} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("foveate", help="the program")
    parser.add_argument("video", help="hockey.mp4")
    parser.add_argument("--out", default="out-hockey", help="folder of the results")
    parser.add_argument("--seeds", type=int, default=10, help="seeds of each of foveate's rows, from 1 on")
    args = parser.parse_args()
    if not shutil.which(args.foveate):
        sys.exit(f"{args.foveate}: no such program; build it by cargo build --release")
    bench = Bench(args)
    bench.followed()
    bench.teams()
    bench.found()
    with open(f"{args.out}/scores.json", "w") as file:
        json.dump(bench.scores, file, indent=1)


if __name__ == "__main__":
    main()
