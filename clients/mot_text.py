"""Tracks in MOTChallenge's text, for motmetrics_figures.py and trackeval_figures.py."""

import numpy as np


def rows(path: str, truth: bool = False) -> np.ndarray:
    """frame, id, x, y, w, h of the rows that count: of results all, of the truth those with a conf that has a whole part."""
    table = np.loadtxt(path, delimiter=",", ndmin=2, usecols=range(7))
    return table[np.trunc(table[:, 6]) != 0][:, :6] if truth else table[:, :6]


def overlaps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """IoU of each box x, y, w, h with each: (n, 4) and (m, 4) give (n, m)."""
    left, right = np.maximum(a[:, None, :2], b[:, :2]), np.minimum((a[:, :2] + a[:, 2:])[:, None], b[:, :2] + b[:, 2:])
    inside = np.prod(np.maximum(right - left, 0), axis=-1)
    return inside / (np.prod(a[:, None, 2:], axis=-1) + np.prod(b[:, 2:], axis=-1) - inside)
