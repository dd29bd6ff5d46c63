"""How good boxes are: one target (OTB's one-pass evaluation), many targets (HOTA, IDF1, MOTA).

Equal to the OTB toolkits' and TrackEval's figures; ``foveate eval`` computes the same.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ._foveate import score_mot, score_ope
from .errors import InputError

Floats = npt.NDArray[np.float64]

__all__ = ["Ope", "mot", "ope"]


class Ope(NamedTuple):
    """One pass over one video."""

    auc: float
    """Area under the success curve, 0 to 1."""
    precision_20: float
    """Share of frames with a centre error of at most 20 pixels."""
    centre_error: float
    """Mean, pixels; infinite where a frame has no box."""
    failures: int
    """Frames with an IoU of 0."""
    frames: int
    """Frames that count: those whose truth is a box."""
    success: Floats
    """Share of frames with an IoU above 0, 0.05 ... 1; shape (21,)."""
    precision: Floats
    """Share of frames with a centre error of at most 0, 1 ... 50 pixels; shape (51,)."""


def ope(boxes: npt.ArrayLike, truth: npt.ArrayLike) -> Ope:
    """Scores the boxes of one target, frame by frame.

    Parameters
    ----------
    boxes, truth : arrays (n, 4)
        Left, top, width, height; a row with a NaN is no box. Frames without a true box count nowhere; the first frame counts with
        the truth in the place of the box there, as in OTB's toolkits.

    >>> score = ope([[0, 0, 10, 10], [5, 0, 10, 10]], [[0, 0, 10, 10], [0, 0, 10, 10]])
    >>> round(score.auc, 3), score.precision_20, score.centre_error
    (0.643, 1.0, 2.5)
    """
    found = json.loads(score_ope(_rows(boxes, "boxes", 4), _rows(truth, "truth", 4)))
    score, curves = found["score"], found["curves"]
    return Ope(
        auc=score["auc"],
        precision_20=score["p20"],
        centre_error=float("inf") if score["cle"] is None else score["cle"],
        failures=score["failures"],
        frames=score["frames"],
        success=np.array(curves["success"]),
        precision=np.array(curves["precision"]),
    )


def mot(tracks: npt.ArrayLike, truth: npt.ArrayLike) -> dict[str, Any]:
    """Scores the boxes of many targets.

    Parameters
    ----------
    tracks, truth : arrays (n, 6) or (n, 7)
        Frame (from 0), id (from 0), left, top, width, height, and confidence; a box of the truth with confidence 0 does not count.

    Returns
    -------
    dict
        ``hota``, ``det_a``, ``ass_a``, ``idf1``, ``mota``, ``switches`` and all else that ``foveate eval`` writes.

    >>> boxes = [[t, 0, 10 + t, 20, 30, 40] for t in range(5)]
    >>> score = mot(boxes, boxes)
    >>> score["hota"], score["idf1"], score["mota"]
    (1.0, 1.0, 1.0)
    """
    found: dict[str, Any] = json.loads(score_mot(_sightings(tracks, "tracks"), _sightings(truth, "truth")))
    return found


def _rows(given: npt.ArrayLike, name: str, width: int) -> Floats:
    rows = np.ascontiguousarray(given, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise InputError(f"{name} has the shape {rows.shape}; expected (n, {width})")
    return rows


def _sightings(given: npt.ArrayLike, name: str) -> Floats:
    rows = np.asarray(given, dtype=np.float64)
    if rows.size == 0:
        return np.empty((0, 7))
    if rows.ndim != 2 or rows.shape[1] not in (6, 7):
        raise InputError(f"{name} has the shape {rows.shape}; expected (n, 6) or (n, 7)")
    if rows.shape[1] == 6:
        rows = np.column_stack([rows, np.ones(len(rows))])
    rows = np.ascontiguousarray(rows)
    whole = (rows[:, :2] >= 0) & (rows[:, :2] == np.floor(rows[:, :2])) & (rows[:, :2] < 1e9)
    if not (np.isfinite(rows).all() and whole.all()):
        raise InputError(f"{name}: numbers are finite, frames and ids whole and from 0 to 1e9")
    return rows
