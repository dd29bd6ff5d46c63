"""The sequences with true boxes that networks are trained on, by the halves that settings are judged by."""
import csv
import glob
import os
import re

import numpy as np

CATALOGUE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../crates/foveate-lab/src/eval/catalogue.csv")


def boxes(path):
    """Rows of (x, y, width, height) with (x, y) the middle, pixels from 0; NaN where the target is out of sight."""
    lines = (re.split("[,\t ]+", line.strip()) for line in open(path))
    left, top, width, height = np.array([[float(x) for x in line[:4]] for line in lines if len(line) >= 4]).T
    return np.stack([left - 1.5 + width / 2, top - 1.5 + height / 2, width, height], 1)


def sequences(data, half, more=None):
    """Name, kind, folder, pictures and true boxes of those of one half, or of all where it is None.

    `more` is a copy of tracking-train whose unpack.sh was run; its kinds are those of its halves.txt, that of the others is "35".
    """
    rows = csv.DictReader(line for line in open(CATALOGUE) if not line.startswith("#"))
    for name in [row["sequence"] for row in rows if half in (None, row["half"])]:
        folder = next(f for d in ("tracking", "tracking-wide") for f in [f"{data}/{d}/{name.removesuffix('-2')}"] if os.path.isdir(f))
        truth = boxes(f"{folder}/groundtruth_rect{'.2' if name.endswith('-2') else ''}.txt")
        yield name, "35", folder, sorted(glob.glob(f"{folder}/img/*.jpg"))[: len(truth)], truth
    for line in open(f"{more}/halves.txt") if more else []:
        if line.startswith("#") or not line.strip():
            continue
        its, name, kind = line.split()[:3]
        if half in (None, its):
            truth = boxes(f"{more}/{name}/groundtruth_rect.txt")
            yield name, kind, f"{more}/{name}", sorted(glob.glob(f"{more}/{name}/img/*.jpg"))[: len(truth)], truth
