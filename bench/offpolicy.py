#!/usr/bin/env python3
"""Estimate the mean reward of gaze policies from the looks of another policy, before any of them is run.

Usage: bench/offpolicy.py FOVEATE --seqs DIR... [--config narrow] [--set KEY=VALUE]... [--seed 201] [--commit 30]

Each sequence is tracked once with random gazes, so every gaze has the probability 1/9 (the propensity). An estimate reads only the
reward of the gaze that was drawn. `--regret` also records the rewards of all nine gazes, which give the true value of a policy.

  ips      inverse propensity score: mean of w r, with w = p(gaze | policy) / p(gaze | random) (Horvitz and Thompson, 1952)
  snips    the same divided by the mean of w (Swaminathan and Joachims, 2015)
  dr       doubly robust (Dudik, Langford and Li, 2011): mean of m(policy) + w (r - m(gaze)); the model m is the mean reward of the
           gaze in all earlier frames, after one frame at the mean of all gazes

All rewards are those under the belief of the random gazes. They do not say what the belief would be under another policy. The reward
`agreement` compares a look with the belief that it made itself, so the reward of the drawn gaze is too high, and no estimate holds.
"""

import argparse
import csv
import math
import pathlib
import random
import statistics
import subprocess
import tempfile


def looks(program, folder, args, seed, out):
    """The index of the drawn gaze and the rewards of all gazes, for each frame."""
    command = [program, "track", folder, "--config", args.config, "--policy", "random", "--seed", str(seed), "--regret"]
    command += [word for setting in args.set for word in ("--set", setting)]
    subprocess.run([*command, "--no-video", "--no-report", "--out", out], check=True, capture_output=True)
    with open(pathlib.Path(out, "regret.csv"), newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = [name for name in rows[0] if name.startswith("reward_")]
    gazes = [tuple(float(x) for x in name.split("_")[1:]) for name in names]
    drawn = [gazes.index((float(row["gaze_u"]), float(row["gaze_v"]))) for row in rows]
    return gazes, drawn, [[float(row[name]) for name in names] for row in rows]


def estimates(drawn, offered, policy):
    """True value and the three estimates of a policy: for each frame a probability for each gaze."""
    n = len(offered[0])
    total, count = [0.0] * n, [0] * n
    true, ips, weights, dr = [], [], [], []
    for arm, rewards, p in zip(drawn, offered, policy):
        mean = sum(total) / max(sum(count), 1)
        model = [(total[k] + mean) / (count[k] + 1) for k in range(n)]
        w, r = p[arm] * n, rewards[arm]
        true.append(sum(a * b for a, b in zip(p, rewards)))
        ips.append(w * r)
        weights.append(w)
        dr.append(sum(a * b for a, b in zip(p, model)) + w * (r - model[arm]))
        total[arm] += r
        count[arm] += 1
    mean = statistics.fmean
    return mean(true), mean(ips), mean(ips) / mean(weights) if any(weights) else mean(ips), mean(dr)


def policies(gazes, drawn, offered, commit):
    """The policies: probabilities for each frame. The learned ones see only the rewards of the drawn gazes of earlier frames."""
    n, frames = len(gazes), len(offered)
    alone = lambda k: [float(j == k) for j in range(n)]
    found = {f"fixed {u:g}, {v:g}": [alone(k)] * frames for k, (u, v) in enumerate(gazes)}
    found["random"] = [[1 / n] * n] * frames
    total, count, chosen, soft = [0.0] * n, [0] * n, [], []
    best = gazes.index((0.0, 0.0))
    for t, (arm, rewards) in enumerate(zip(drawn, offered)):
        mean = sum(total) / max(sum(count), 1)
        score = [(total[k] + mean) / (count[k] + 1) for k in range(n)]
        best = max(range(n), key=lambda k: score[k]) if t == commit else best
        chosen.append(alone(best))
        weights = [math.exp((s - max(score)) / 0.05) for s in score]
        soft.append([w / sum(weights) for w in weights])
        total[arm] += rewards[arm]
        count[arm] += 1
    return found | {f"commit after {commit}": chosen, "softmax of the means": soft}


def interval(values):
    """95 % bootstrap interval of the mean over sequences."""
    rng = random.Random(1)
    means = sorted(statistics.fmean(rng.choices(values, k=len(values))) for _ in range(2000))
    return means[50], means[1949]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", metavar="FOVEATE")
    parser.add_argument("--seqs", nargs="+", required=True, type=pathlib.Path)
    parser.add_argument("--config", default="narrow")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--seed", type=int, default=201, help="of the first sequence; each has its own draws")
    parser.add_argument("--commit", type=int, default=30)
    args = parser.parse_args()
    folders = sorted(p for d in args.seqs for p in d.iterdir() if (p / "groundtruth_rect.txt").exists())
    results = {}
    with tempfile.TemporaryDirectory() as out:
        for k, folder in enumerate(folders):
            gazes, drawn, offered = looks(args.program, folder, args, args.seed + k, f"{out}/{k}")
            for name, policy in policies(gazes, drawn, offered, args.commit).items():
                results.setdefault(name, []).append(estimates(drawn, offered, policy))
            print(f"{k + 1} of {len(folders)}: {folder.name}", flush=True)
    print(f"\n{'policy':<22}{'true':>8}{'  minus random, 95 %':>26}" + "".join(f"{e + ': mean, rmse':>18}" for e in ("ips", "snips", "dr")))
    base = [row[0] for row in results["random"]]
    for name, rows in sorted(results.items(), key=lambda item: -statistics.fmean(row[0] for row in item[1])):
        gain = [row[0] - b for row, b in zip(rows, base)]
        low, high = interval(gain)
        text = f"{name:<22}{statistics.fmean(row[0] for row in rows):>8.4f}{statistics.fmean(gain):>+10.4f} [{low:+.4f}, {high:+.4f}]"
        for e in (1, 2, 3):
            rmse = math.sqrt(statistics.fmean((row[e] - row[0]) ** 2 for row in rows))
            text += f"{statistics.fmean(row[e] for row in rows):>11.4f}{rmse:>7.4f}"
        print(text)


if __name__ == "__main__":
    main()
