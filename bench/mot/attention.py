#!/usr/bin/env python3
"""Compares the orders of looks if boxes come in some frames only and looks are few (docs/looking.md).

Usage:
  bench/mot/attention.py --data data/mot --every 10 --out out-attention       # python3 alone; foveate is on the PATH, or --foveate

Boxes are the true ones of every N-th frame. In all frames, those in between as well, so many targets are looked at as --budgets
say. A box starts a track at once; a track ends that two of them in a row miss, and is reported until one does.

Output: OUT/det/SEQUENCE.txt, OUT/LINE/SEED/SEQUENCE/ and, printed, a table: means over seeds, all sequences pooled, and the
difference from round robin, paired by seed, with a 95 % bootstrap interval over seeds.
"""
import argparse
import json
import os
import random
import statistics
import subprocess

SETTINGS = ["initiation.hits=1", "initiation.within=1", "initiation.rank=0", "weak=0", "termination.unseen=2", "termination.guess=0"]
POLICIES = ["round-robin", "surprise"]


def boxes(truth, every):
    """Lines of a detection file: the true boxes of every `every`-th frame."""
    with open(truth) as file:
        rows = [line.strip().split(",") for line in file if line.strip()]
    return [",".join([row[0], "-1", *row[2:6], "1"]) for row in rows if (int(row[0]) - 1) % every == 0 and row[6] == "1"]


def interval(differences):
    rng, n = random.Random(1), len(differences)
    means = sorted(statistics.mean(rng.choices(differences, k=n)) for _ in range(4000))
    return means[100], means[3900]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", required=True, help="folder of sequences in MOTChallenge's layout")
    parser.add_argument("--every", type=int, default=10, help="boxes in every so many frames")
    parser.add_argument("--budgets", type=int, nargs="+", default=[1, 2, 3], help="looks a frame")
    parser.add_argument("--seeds", type=int, default=20, help="seeds, from 1")
    parser.add_argument("--out", default="out-attention")
    parser.add_argument("--foveate", default="foveate")
    args = parser.parse_args()
    sequences = sorted(name for name in os.listdir(args.data) if os.path.isfile(os.path.join(args.data, name, "gt", "gt.txt")))
    os.makedirs(os.path.join(args.out, "det"), exist_ok=True)
    for name in sequences:
        with open(os.path.join(args.out, "det", name + ".txt"), "w") as file:
            file.write("\n".join(boxes(os.path.join(args.data, name, "gt", "gt.txt"), args.every)) + "\n")

    def run(line, settings):
        results = []
        for seed in range(1, args.seeds + 1):
            results.append(os.path.join(args.out, line, str(seed)))
            for name in sequences:
                command = [args.foveate, "track", os.path.join(args.data, name), "--no-video", "--no-report", "--seed", str(seed)]
                command += ["--detections", os.path.join(args.out, "det", name + ".txt"), "--out", os.path.join(results[-1], name)]
                for setting in [f"every={args.every}", *SETTINGS, *settings]:
                    command += ["--set", "multi_target." + setting]
                subprocess.run(command, check=True, capture_output=True)
        scored = os.path.join(args.out, line, "scores")
        subprocess.run([args.foveate, "eval", "--mot", "--truth", args.data, "--results", *results, "--out", scored],
                       check=True, capture_output=True)
        with open(os.path.join(scored, "scores.json")) as file:
            return [result["pooled"] for result in json.load(file)["trackers"]]

    def row(budget, policy, scores, base=None):
        mean = lambda key: statistics.mean(score[key] for score in scores)
        text = f"| {budget} | {policy} | {mean('hota'):.3f} | {mean('idf1'):.3f} | {mean('switches'):.1f} |"
        if base:
            differences = [a["hota"] - b["hota"] for a, b in zip(scores, base)]
            low, high = interval(differences)
            text += f" {statistics.mean(differences):+.3f} [{low:+.3f}, {high:+.3f}]"
        print(text + " |", flush=True)

    print("| looks a frame | policy | HOTA | IDF1 | identity switches | HOTA against round robin |")
    print("| --- | --- | --- | --- | --- | --- |")
    row("all", "", run("all", []))
    for budget in args.budgets:
        base = None
        for policy in POLICIES:
            scores = run(f"{budget}-{policy}", [f"attention.budget={budget}", f"attention.policy={policy}"])
            row(budget, policy, scores, base)
            base = base or scores


if __name__ == "__main__":
    main()
