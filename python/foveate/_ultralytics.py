"""What ultralytics' models answer, as detections."""

from __future__ import annotations

from typing import Any

from .errors import InputError


def boxes_of(detections: Any) -> Any:
    """The boxes of ultralytics' ``Results``, or of the list with one that a model answers, on the CPU; all else as it is.

    >>> boxes_of([[1, 2, 3, 4]])
    [[1, 2, 3, 4]]
    """
    if isinstance(detections, (list, tuple)) and detections and all(map(_is_results, detections)):
        if len(detections) > 1:
            raise InputError(f"these are the detections of {len(detections)} pictures; give those of one, for example results[0]")
        detections = detections[0]
    if _is_results(detections):
        detections = detections.obb if detections.boxes is None else detections.boxes
    return detections.cpu() if hasattr(detections, "xyxy") and hasattr(detections, "cpu") else detections


def _is_results(one: Any) -> bool:
    """Its turned boxes, ``obb``, tell it from other types with boxes."""
    return hasattr(one, "boxes") and hasattr(one, "obb")
