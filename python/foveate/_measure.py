"""Motion in metres and seconds."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, overload

import numpy as np
import numpy.typing as npt

from ._foveate import Tracker, Video, measure_tracks
from .errors import InputError

_Floats = npt.NDArray[np.float64]


class Value(NamedTuple):
    """A parameter of a fit with its standard error, which includes those of scale and clock."""

    value: float
    error: float
    """Standard error, in the same unit."""
    interval: tuple[float, float]
    """The 95 % interval; an end may be infinite."""
    unit: str


class Fit(NamedTuple):
    """A fitted curve."""

    fit: str
    """The request, such as ``"parabola:y"``."""
    formula: str
    t0: float
    """The time at which t of the formula is 0, seconds."""
    values: dict[str, Value]
    """The parameters by their names in the formula, then derived quantities such as ``"g"``."""
    points: int
    rms: float
    """Root mean square of the residuals, in the unit of length."""
    correlation: float
    """The correlation of the residuals from one picture to the next, 0 to below 1."""


class Ask(NamedTuple):
    """A stretch of doubtful pictures, counted from 0."""

    frame: int
    """The most doubtful one."""
    stretch: tuple[int, int]
    """The first and the last one."""
    p_lost: float
    region: float | None
    """Radius of the 90 % region of the position, pixels; None where it is unknown."""
    reason: str
    """``"lost"``, ``"region"`` or ``"leap"``."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """The motion of a point in n pictures, from the first to the last with a position. Arrays are float64; the columns of those of shape
    (n, 2) are x and y, y upwards. Lengths are in ``unit``, times in seconds; the arrays ``sd_...`` are standard errors."""

    unit: str
    """The unit of length: ``"m"``, or ``"px"`` without a ruler."""
    frame: npt.NDArray[np.int64]
    """Where the pictures stand in the video, counted from 0; shape (n,)."""
    time: _Floats
    """Seconds; shape (n,)."""
    position: _Floats
    sd_position: _Floats
    velocity: _Floats
    """Length per second; shape (n, 2)."""
    sd_velocity: _Floats
    acceleration: _Floats
    """Length per second squared; shape (n, 2)."""
    sd_acceleration: _Floats
    tracked: _Floats
    """The tracked position before smoothing; NaN where the target was occluded or lost; shape (n, 2)."""
    p_lost: _Floats
    """The probability that the target is lost, 0 to 1; shape (n,)."""
    status: list[str]
    """The status in each picture: ``"given"`` where the box was given, otherwise as in :class:`foveate.Result`."""
    fits: list[Fit]
    ask: list[Ask]
    """The pictures to look at, most doubtful first."""
    notes: list[str]
    """Fits that failed, that are no better than a constant, or whose decay is none: whole sentences."""

    def __repr__(self) -> str:
        return f"<Measurement of {len(self.frame)} pictures in {self.unit}, {len(self.fits)} fits>"


@overload
def measure(
    video: Video | str | os.PathLike[str] | Sequence[Any],
    init: Mapping[str, Sequence[float]],
    *,
    ruler: Sequence[float] | None = None,
    fit: str | Iterable[str] = (),
    origin: tuple[float, float] | None = None,
    angle: float = 0.0,
    fps: float | tuple[float, float] | None = None,
    lens: str | os.PathLike[str] | None = None,
    reference: Sequence[float] | None = None,
    **tracker: Any,
) -> dict[str, Measurement]: ...
@overload
def measure(
    video: Video | str | os.PathLike[str] | Sequence[Any],
    init: Sequence[float],
    *,
    ruler: Sequence[float] | None = None,
    fit: str | Iterable[str] = (),
    origin: tuple[float, float] | None = None,
    angle: float = 0.0,
    fps: float | tuple[float, float] | None = None,
    lens: str | os.PathLike[str] | None = None,
    reference: Sequence[float] | None = None,
    **tracker: Any,
) -> Measurement: ...
def measure(
    video: Video | str | os.PathLike[str] | Sequence[Any],
    init: Sequence[float] | Mapping[str, Sequence[float]],
    *,
    ruler: Sequence[float] | None = None,
    fit: str | Iterable[str] = (),
    origin: tuple[float, float] | None = None,
    angle: float = 0.0,
    fps: float | tuple[float, float] | None = None,
    lens: str | os.PathLike[str] | None = None,
    reference: Sequence[float] | None = None,
    **tracker: Any,
) -> Measurement | dict[str, Measurement]:
    """Measures motion with errors, as the program ``foveate measure`` does, with the same numbers.

    Parameters
    ----------
    video : Video, path, or sequence of pictures
        Read once. Pictures without a video have no times: give ``fps``.
    init : four numbers, or a dict of them
        The target in the first picture: left, top, width, height; pixels from 0. A dict has several points by name; each is tracked
        on its own.
    ruler : (x1, y1, x2, y2, metres) or (x1, y1, x2, y2, metres, error), optional
        Two points in the picture, pixels from 0, the length between them, and its standard error in metres. Omit it to measure in
        pixels.
    fit : str or several
        Curves as in the program: ``"parabola:y"``, ``"sine:x:0.1-2.5"``; ``line``, ``parabola``, ``sine``, ``damped``,
        ``exponential``, ``drag``.
    origin : (x, y), optional
        Pixels from 0. Default: the first position of the first point.
    angle : float
        Direction of the x axis, degrees anticlockwise from the picture's right.
    fps : float or (rate, error), optional
        Pictures per second at which the scene was recorded. Default: the times of the video.
    lens : path, optional
        A calibration file of OpenCV, whose distortion is taken out.
    reference : four numbers, optional
        A box around a thing at rest in the first picture, for a moving camera. It is tracked too, and positions are relative to it.
    **tracker
        Arguments of :class:`foveate.Tracker`, such as ``profile`` and ``seed``.

    Returns
    -------
    Measurement, or a dict of them by name
        As ``init``.

    Raises
    ------
    foveate.InputError
        An argument is invalid, there are too few pictures with a position, or their times are unknown.
    foveate.FileError
        The video or the calibration cannot be read.

    Examples
    --------
    >>> import numpy as np, foveate
    >>> def picture(t):
    ...     image = np.arange(160 * 120, dtype=np.uint8).reshape(120, 160) % 7
    ...     image[40:64, 20 + 4 * t : 44 + 4 * t] = 200
    ...     return image
    >>> pictures = [picture(t) for t in range(16)]
    >>> ball = foveate.measure(pictures, (16, 36, 32, 32), ruler=(0, 0, 100, 0, 1.0), fps=25, fit="line:x", profile="fast")
    >>> ball.position.shape, ball.unit
    ((16, 2), 'm')
    >>> speed = ball.fits[0].values["v"]
    >>> abs(speed.value - 1.0) < 0.1, speed.unit
    (True, 'm/s')
    """
    points = init if isinstance(init, Mapping) else {"1": init}
    if isinstance(video, (str, os.PathLike)):
        channels = str(tracker.get("channels", "rgb"))
        with Video(video, channels="bgr" if channels.startswith("bgr") else "rgb") as opened:
            tracks, size = _tracks(opened, points, reference, fps is not None, tracker)
    else:
        tracks, size = _tracks(video, points, reference, fps is not None, tracker)
    still = None if reference is None else tracks.pop()
    if ruler is not None and len(ruler) not in (5, 6):
        raise InputError(f"ruler is (x1, y1, x2, y2, metres) or with its error; it has {len(ruler)} numbers")
    length = None if ruler is None else (list(ruler[:4]), ruler[4], ruler[5] if len(ruler) == 6 else 0.0)
    clock = fps if fps is None or isinstance(fps, tuple) else (fps, 0.0)
    requests = [fit] if isinstance(fit, str) else list(fit)
    bent = None if lens is None else (lens, size)
    found = measure_tracks(list(zip(points, tracks)), still, length, origin, angle, clock, requests, bent)
    measured = {name: _measurement(fields) for name, fields in zip(points, found)}
    return measured if isinstance(init, Mapping) else measured["1"]


def _tracks(
    video: Any, points: Mapping[str, Sequence[float]], reference: Sequence[float] | None, timed: bool, settings: dict[str, Any]
) -> tuple[list[list[Any]], tuple[int, int]]:
    """Follows the points, then the reference, and returns the positions of each, and width and height of the pictures."""
    size = (0, 0)
    trackers = [(Tracker(**settings), box, list[Any]()) for box in points.values()]
    if reference is not None:
        # With another seed than the points: their errors are independent of its errors.
        seed = (Tracker(**settings).seed + 1) % 2**64
        trackers.append((Tracker(**settings | {"seed": seed}), reference, list[Any]()))
    for at, image in enumerate(video):
        if at == 0:
            height, width = np.shape(image)[:2]
            size = (width, height)
        opened = video if isinstance(video, Video) else None
        frame, time = (at, None) if opened is None else (opened.frame, opened.time)
        if time is None and not timed:
            raise InputError("the times of the pictures are unknown: give fps, or a video")
        for tracker, box, track in trackers:
            if time is not None:
                tracker.set_time(time)
            seen = tracker.init(image, box) if at == 0 else tracker.update(image)
            c = None if at == 0 else seen.covariance
            covariance = None if c is None else (c[0, 0], c[0, 1], c[1, 1])
            centre, status = (seen.state.x, seen.state.y), "given" if at == 0 else seen.status
            track.append((frame, 0.0 if time is None else time, centre, covariance, seen.p_lost, status, seen.ok))
    return [track for _, _, track in trackers], size


def _measurement(fields: dict[str, Any]) -> Measurement:
    def fitted(fit: str, formula: str, t0: float, values: list[Any], *rest: Any) -> Fit:
        return Fit(fit, formula, t0, {name: Value(*value) for name, *value in values}, *rest)

    fits = [fitted(*fit) for fit in fields.pop("fits")]
    return Measurement(**fields | {"fits": fits, "ask": [Ask(*ask) for ask in fields["ask"]]})
