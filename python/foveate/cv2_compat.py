"""OpenCV's interface of a tracker, for programs that have one: boxes in whole pixels, plain tuples, pictures in blue, green, red.

>>> import numpy as np
>>> from foveate import cv2_compat
>>> frame = np.random.default_rng(1).integers(0, 256, (120, 160, 3), dtype=np.uint8)
>>> tracker = cv2_compat.TrackerFoveate_create()
>>> tracker.init(frame, (40, 30, 24, 24))
>>> ok, (x, y, w, h) = tracker.update(frame)
>>> ok, frame[y : y + h, x : x + w].shape == (h, w, 3)
(True, True)

:class:`foveate.Tracker` returns more: status, P(lost), covariance, particles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ._foveate import Tracker
from .errors import InputError

if TYPE_CHECKING:
    from ._foveate import _Box, _Config, _Image

__all__ = ["TrackerFoveate", "TrackerFoveate_create"]


class TrackerFoveate:
    """A tracker with OpenCV's methods, as ``cv2.TrackerCSRT`` has them. Arguments are those of :class:`foveate.Tracker`."""

    def __init__(self, profile: str = "balanced", config: _Config | None = None, seed: int | None = None) -> None:
        """A tracker without a target."""
        self._tracker = Tracker(profile, config, seed, channels="bgr")
        self._score: float | None = None

    @staticmethod
    def create(profile: str = "balanced", config: _Config | None = None, seed: int | None = None) -> TrackerFoveate:
        """A tracker without a target, as ``cv2.TrackerCSRT.create()``."""
        return TrackerFoveate(profile, config, seed)

    def init(self, image: _Image, boundingBox: _Box) -> None:
        """Starts, or starts again, on the target in this box: left, top, width, height."""
        self._tracker.init(image, boundingBox)
        self._score = 1.0

    def update(self, image: _Image) -> tuple[bool, tuple[int, int, int, int]]:
        """The next picture: whether the target is there, and its box.

        The box is in whole pixels, cut at the picture's borders, and at least one pixel wide and high, so that
        ``frame[y:y+h, x:x+w]`` is a picture. It is a guess where the target is not there.
        """
        seen = self._tracker.update(image)
        self._score = 1 - seen.p_lost
        height, width = np.asarray(image).shape[:2]
        x, y, w, h = seen.box
        left, right = _whole(x, x + w, width)
        top, bottom = _whole(y, y + h, height)
        return seen.ok, (left, top, right - left, bottom - top)

    def getTrackingScore(self) -> float:
        """How sure the last box is, 0 to 1: 1 - P(lost)."""
        if self._score is None:
            raise InputError("the tracker has no target: call init with a picture and a box first")
        return self._score


TrackerFoveate_create = TrackerFoveate.create


def _whole(begin: float, end: float, side: int) -> tuple[int, int]:
    """Whole pixels from begin to end inside of a side, at least one."""
    first = min(max(round(begin), 0), side - 1)
    return first, min(max(round(end), first + 1), side)
