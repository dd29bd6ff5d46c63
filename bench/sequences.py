"""The sequences with true boxes that networks are trained on, by the halves that settings are judged by."""
import csv
import glob
import os
import re

import numpy as np

CATALOGUE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../crates/foveate-lab/src/eval/catalogue.csv")


def boxes(path):
    """Rows of (x, y, width, height) with (x, y) the middle, pixels from 0."""
    lines = (re.split("[,\t ]+", line.strip()) for line in open(path))
    left, top, width, height = np.array([[float(x) for x in line[:4]] for line in lines if len(line) >= 4]).T
    return np.stack([left - 1.5 + width / 2, top - 1.5 + height / 2, width, height], 1)


def sequences(data, half):
    """Name, pictures and true boxes of those of one half, or of all where it is None."""
    rows = csv.DictReader(line for line in open(CATALOGUE) if not line.startswith("#"))
    for name in [row["sequence"] for row in rows if half in (None, row["half"])]:
        folder = next(f for d in ("tracking", "tracking-wide") for f in [f"{data}/{d}/{name.removesuffix('-2')}"] if os.path.isdir(f))
        truth = boxes(f"{folder}/groundtruth_rect{'.2' if name.endswith('-2') else ''}.txt")
        yield name, sorted(glob.glob(f"{folder}/img/*.jpg"))[: len(truth)], truth
