"""The figures of py-motmetrics for tracks in MOTChallenge's text.

    python clients/motmetrics_figures.py gt.txt tracks.txt

IoU 0.5 is what a match needs, as in `foveate eval --mot`. The distances are computed here: motmetrics 1.4's own need numpy below 2.
"""

import sys

import motmetrics as mm
import numpy as np
from mot_text import overlaps, rows


def distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """1 - IoU of each box x, y, w, h with each; NaN where they cannot be a match."""
    iou = overlaps(a, b)
    return np.where(iou >= 0.5, 1 - iou, np.nan)


def figures(truth: str, tracks: str) -> dict[str, float]:
    """MOTA, IDF1 and the number of identity switches."""
    true, found = rows(truth, truth=True), rows(tracks)
    matches = mm.MOTAccumulator()
    for frame in np.unique(np.concatenate([true[:, 0], found[:, 0]])):
        a, b = true[true[:, 0] == frame], found[found[:, 0] == frame]
        matches.update(a[:, 1].astype(int), b[:, 1].astype(int), distances(a[:, 2:], b[:, 2:]), frameid=int(frame))
    table = mm.metrics.create().compute(matches, metrics=["mota", "idf1", "num_switches"], name="all")
    return {name: float(table[name]["all"]) for name in table}


if __name__ == "__main__":
    print(figures(*sys.argv[1:3]))
