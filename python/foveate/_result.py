"""The result of one picture."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from ._types import Box, Region, State

if TYPE_CHECKING:
    from ._foveate import _Estimate

_Floats = npt.NDArray[np.float64]
Status = Literal["tracking", "occluded", "lost", "reacquired"]

LOG = logging.getLogger("foveate")


class Result(tuple[bool, Box]):
    """The result of one picture, from :meth:`Tracker.update`.

    It is a tuple of ``ok`` and ``box``, as OpenCV's, with attributes:

    >>> import numpy as np, foveate
    >>> image = np.random.default_rng(1).integers(0, 256, (120, 160), dtype=np.uint8)
    >>> seen = foveate.Tracker("fast").init(image, (40, 30, 24, 24))
    >>> ok, box = seen
    >>> seen[1] == box == seen.box, seen.p_lost
    (True, 0.0)

    Arrays are read-only, made without a copy on access, and stay valid after the next update.
    """

    image: Any
    """The picture, in results of :meth:`Tracker.track` until the next picture is read; otherwise None."""
    frame: int | None
    """Where the picture stands in the video, counted from 0; None where that is not known."""
    time: float | None
    """Seconds from the first picture of the video; None where that is not known."""
    channels: str
    """The order of a colour picture's bytes, as the tracker has it."""

    def __new__(cls, estimate: _Estimate, channels: str = "rgb", frame: int | None = None, time: float | None = None) -> Result:
        """Of what the tracker estimated."""
        self = super().__new__(cls, (estimate.ok, estimate.box))
        self._estimate = estimate
        self.channels, self.frame, self.time, self.image = channels, frame, time, None
        return self

    _estimate: _Estimate

    @property
    def ok(self) -> bool:
        """Whether the box is usable: the status is tracking or reacquired. False where it is occluded or lost, and the box a guess."""
        return self[0]

    @property
    def box(self) -> Box:
        """The target's upright box: left, top, width, height; pixels from 0. A guess where ``ok`` is false."""
        return self[1]

    @property
    def p_lost(self) -> float:
        """The probability, 0 to 1, that the box is not on the target (IoU below 0.1) or that the target is not visible."""
        return self._estimate.p_lost

    @property
    def status(self) -> Status:
        """The status, which follows from ``p_lost``: ``"tracking"``, ``"occluded"``, ``"lost"`` or ``"reacquired"``."""
        return self._estimate.status

    @property
    def state(self) -> State:
        """Mean of the belief, moved by the box regression where there is one: centre, velocity, log scale, angle, log aspect."""
        return self._estimate.state

    @property
    def covariance(self) -> _Floats:
        """Covariance of the belief over x, y, vx, vy, log scale, angle, log aspect; float64, shape (7, 7)."""
        return self._estimate.covariance

    @property
    def ess(self) -> float:
        """Effective sample size 1 / Σ w², from 1 to the number of particles; 0 in a picture whose box was given."""
        return self._estimate.ess

    @property
    def log_evidence(self) -> float:
        """Log evidence of the picture, nats, up to the likelihood's constant; NaN in a picture whose box was given."""
        return self._estimate.log_evidence

    @property
    def particles(self) -> _Floats:
        """The predicted particles; float64, shape (n, 7): x, y, vx, vy, log scale, angle, log aspect."""
        return self._estimate.particles

    @property
    def weights(self) -> _Floats:
        """Weights of the particles, which sum to 1; float64, shape (n,)."""
        return self._estimate.weights

    @property
    def gaze(self) -> tuple[float, float]:
        """The policy's own gaze (u, v) in template units: the box is the square from -1 to 1."""
        return self._estimate.gaze

    @property
    def gazes(self) -> _Floats:
        """All gazes that were scored, template units; float64, shape (k, 2)."""
        return self._estimate.gazes

    @property
    def rewards(self) -> _Floats:
        """The reward, 0 to 1, of each of ``gazes``; float64, shape (k,)."""
        return self._estimate.rewards

    @property
    def classes(self) -> dict[str, float]:
        """Probability of each class over all pictures so far, by name; empty without a recogniser."""
        return self._estimate.classes

    def region(self, p: float = 0.9) -> Region:
        """The credible region of the target's centre that holds this share (0 to below 1) of the probability: an ellipse."""
        return self._estimate.region(p)

    def __bool__(self) -> bool:
        return self[0]

    def __reduce__(self) -> tuple[Any, ...]:
        return Result, (self._estimate, self.channels, self.frame, self.time)

    def __repr__(self) -> str:
        x, y, w, h = self[1]
        return f"<Result {self.status} box=({x:.1f}, {y:.1f}, {w:.1f}, {h:.1f}) p_lost={self.p_lost:.3f}>"

    def _repr_html_(self) -> str:
        from ._show import result_html  # noqa: PLC0415: it needs this module

        return result_html(self)


def log_status(result: Result) -> None:
    """Another status than that of the picture before."""
    x, y, w, h = result.box.rounded()
    LOG.info("%s at %d, %d, %d x %d, P(lost) %.2f", result.status, x, y, w, h, result.p_lost)


def log_video(video: str) -> None:
    """A video that was opened."""
    LOG.debug("opened %s", video)
