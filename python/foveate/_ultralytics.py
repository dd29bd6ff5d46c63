"""What ultralytics' models answer, as detections."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .errors import InputError


def boxes_of(detections: Any) -> Any:
    """The boxes of ultralytics' ``Results``, or of the list with one that a model answers, on the CPU; all else as it is.

    >>> boxes_of([[1, 2, 3, 4]])
    [[1, 2, 3, 4]]
    """
    detections = _one(detections)
    if _is_results(detections):
        detections = detections.obb if detections.boxes is None else detections.boxes
    return detections.cpu() if hasattr(detections, "xyxy") and hasattr(detections, "cpu") else detections


def names_of(detections: Any) -> dict[int, str]:
    """Names of the classes of ultralytics' ``Results``, by number; none for all else.

    >>> names_of([[1, 2, 3, 4]])
    {}
    """
    results = _one(detections)
    names = getattr(results, "names", None) if _is_results(results) else None
    return {int(number): str(name) for number, name in names.items()} if isinstance(names, Mapping) else {}


def _one(detections: Any) -> Any:
    """The only ``Results`` of the list that a model answers; all else as it is."""
    if not (isinstance(detections, (list, tuple)) and detections and all(map(_is_results, detections))):
        return detections
    if len(detections) > 1:
        raise InputError(f"these are the detections of {len(detections)} pictures; give those of one, for example results[0]")
    return detections[0]


def _is_results(one: Any) -> bool:
    """Its rotated boxes, ``obb``, identify it among other types with boxes."""
    return hasattr(one, "boxes") and hasattr(one, "obb")
