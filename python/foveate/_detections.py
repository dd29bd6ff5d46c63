"""Detections of a frame, in the forms that detectors have them in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ._ultralytics import boxes_of, names_of
from .errors import InputError


@dataclass(frozen=True, eq=False)
class Found:
    """The detections of one frame; row i of every array, and value i of every list, is the same detection."""

    rows: npt.NDArray[np.float64]
    """Left, top, width, height, score, shape (n, 5); the score is NaN where the detector gives none."""
    classes: npt.NDArray[np.int64]
    """Class numbers, -1 where the detector gives none, shape (n,)."""
    names: dict[int, str] = field(default_factory=dict)
    """Names of classes, by number."""
    data: dict[str, Any] = field(default_factory=dict)
    """Whatever else came with them: arrays or lists of n values, by name."""


def rows(detections: object) -> npt.NDArray[np.float64]:
    """Detections as rows of left, top, width, height and score.

    >>> rows([[1, 2, 3, 4]])
    array([[ 1.,  2.,  3.,  4., nan]])
    """
    return read(detections).rows


def read(detections: object) -> Found:
    """Detections of any form, checked."""
    boxes = boxes_of(detections)
    found = _of_object(boxes) if hasattr(boxes, "xyxy") else _of_array(boxes)
    _check(found.rows)
    return found if found.names else replace(found, names=names_of(detections))


def _none() -> Found:
    return Found(np.empty((0, 5)), np.empty(0, dtype=np.int64))


def _of_object(detections: Any) -> Found:
    """Of supervision's ``Detections``, ultralytics' ``Boxes``, and what has the same attributes."""
    corners = np.asarray(detections.xyxy, dtype=np.float64)
    if corners.size == 0:
        return _none()
    if corners.ndim != 2 or corners.shape[1] != 4:
        raise InputError(f"xyxy of the detections has the shape {corners.shape}; expected (n, 4): left, top, right, bottom")

    def column(names: tuple[str, str], missing: float) -> npt.NDArray[np.float64]:
        values = next((v for v in (getattr(detections, name, None) for name in names) if v is not None), None)
        numbers = np.full(len(corners), missing) if values is None else np.asarray(values, dtype=np.float64).reshape(-1)
        if len(numbers) != len(corners):
            raise InputError(f"detections have {len(corners)} boxes in xyxy and {len(numbers)} numbers in {names[0]}")
        return numbers

    found = np.column_stack([corners[:, :2], corners[:, 2:] - corners[:, :2], column(("confidence", "conf"), np.nan)])
    classes = column(("class_id", "cls"), -1).astype(np.int64)
    given = getattr(detections, "data", None)
    data = {str(name): values for name, values in given.items()} if isinstance(given, Mapping) else {}
    for name, values in data.items():
        if len(values) != len(corners):
            raise InputError(f"detections have {len(corners)} boxes in xyxy and {len(values)} values in data[{name!r}]")
    names = {int(c): str(name) for c, name in zip(classes, data.get("class_name", ())) if c >= 0}
    return Found(np.ascontiguousarray(found), classes, names, data)


def _of_array(detections: object) -> Found:
    try:
        found = np.asarray(detections, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(
            "detections are an array (n, 4) or (n, 5) of left, top, width, height and score, or have xyxy and confidence; "
            f"they are of type {type(detections).__name__} ({error})"
        ) from None
    if found.size == 0:
        return _none()
    if found.ndim != 2 or found.shape[1] not in (4, 5):
        raise InputError(f"detections have the shape {found.shape}; expected (n, 4) or (n, 5): left, top, width, height and score")
    if found.shape[1] == 4:
        found = np.column_stack([found, np.full(len(found), np.nan)])
    return Found(np.ascontiguousarray(found), np.full(len(found), -1, dtype=np.int64))


def _check(found: npt.NDArray[np.float64]) -> None:
    """Refuses boxes that are none; a score may be missing (NaN)."""
    infinite = np.flatnonzero(~np.isfinite(found[:, :4]).all(axis=1) | np.isinf(found[:, 4]))
    if len(infinite):
        i = int(infinite[0])
        raise InputError(f"detection {i} is not finite: {found[i].tolist()}")
    empty = np.flatnonzero((found[:, 2:4] <= 0).any(axis=1))
    if len(empty):
        i = int(empty[0])
        raise InputError(
            f"detection {i} is {found[i, 2]:g} wide and {found[i, 3]:g} high: {found[i, :4].tolist()}; expected left, top, width, "
            "height with width and height above 0 (give corners as an object with xyxy)"
        )
