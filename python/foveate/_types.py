"""Results as named tuples."""

from __future__ import annotations

from typing import NamedTuple


def counted(n: int, noun: str) -> str:
    """A count and its noun, given in the singular; regular plurals in s alone.

    >>> counted(1, "video"), counted(2, "video")
    ('1 video', '2 videos')
    """
    return f"{n} {noun}" + "s" * (n != 1)


class Box(NamedTuple):
    """An upright box; pixels from 0. It is a tuple of four numbers, as OpenCV's.

    >>> box = Box(10.2, 20.0, 30.0, 40.6)
    >>> box.rounded(), box.xyxy[2:]
    ((10, 20, 30, 41), (40.2, 60.6))
    """

    x: float
    """Left edge."""
    y: float
    """Top edge."""
    w: float
    """Width."""
    h: float
    """Height."""

    @property
    def xyxy(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom; right and bottom exclusive."""
        return self.x, self.y, self.x + self.w, self.y + self.h

    def rounded(self) -> tuple[int, int, int, int]:
        """In whole pixels, as OpenCV's drawing functions need it."""
        return round(self.x), round(self.y), round(self.w), round(self.h)


class State(NamedTuple):
    """The estimated state: the mean of the particles, corrected by the box regression if there is one."""

    x: float
    """Centre, pixels."""
    y: float
    """Centre, pixels."""
    vx: float
    """Velocity, pixels a frame."""
    vy: float
    """Velocity, pixels a frame."""
    log_scale: float
    """Natural logarithm of size relative to the first frame."""
    angle: float
    """Turn relative to the first frame, radians, from x towards y."""
    log_aspect: float
    """Natural logarithm of width / height relative to the first frame, at the same area."""


class Region(NamedTuple):
    """An ellipse on the picture that holds a share of the probability of the target's centre."""

    x: float
    """Centre, pixels."""
    y: float
    """Centre, pixels."""
    major: float
    """Half the longer axis, pixels."""
    minor: float
    """Half the shorter axis, pixels."""
    angle: float
    """Direction of the longer axis, radians from x towards y."""
