"""What detectors found, as one array."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ._ultralytics import boxes_of
from .errors import InputError


def rows(detections: object) -> npt.NDArray[np.float64]:
    """Detections as rows of left, top, width, height and score.

    >>> rows([[1, 2, 3, 4]])
    array([[1., 2., 3., 4., 1.]])
    """
    detections = boxes_of(detections)
    if hasattr(detections, "xyxy"):
        corners = np.asarray(detections.xyxy, dtype=np.float64)
        if corners.size == 0:
            return np.empty((0, 5))
        if corners.ndim != 2 or corners.shape[1] != 4:
            raise InputError(f"xyxy of the detections has the shape {corners.shape}; expected (n, 4): left, top, right, bottom")
        scores = getattr(detections, "confidence", getattr(detections, "conf", None))
        column = np.ones(len(corners)) if scores is None else np.asarray(scores, dtype=np.float64).reshape(-1)
        if len(column) != len(corners):
            raise InputError(f"detections have {len(corners)} boxes in xyxy and {len(column)} numbers in confidence")
        found = np.column_stack([corners[:, :2], corners[:, 2:] - corners[:, :2], column])
    else:
        try:
            found = np.asarray(detections, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TypeError(
                "detections are an array (n, 4) or (n, 5) of left, top, width, height and score, or have xyxy and confidence; "
                f"they are of type {type(detections).__name__} ({error})"
            ) from None
        if found.size == 0:
            return np.empty((0, 5))
        if found.ndim != 2 or found.shape[1] not in (4, 5):
            raise InputError(
                f"detections have the shape {found.shape}; expected (n, 4) or (n, 5): left, top, width, height and score"
            )
        if found.shape[1] == 4:
            found = np.column_stack([found, np.ones(len(found))])
    if not np.isfinite(found).all():
        wrong = int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])
        raise InputError(f"detection {wrong} is not finite: {found[wrong].tolist()}")
    return np.ascontiguousarray(found)
