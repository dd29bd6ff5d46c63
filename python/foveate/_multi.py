"""Many targets in one picture, as arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._types import Box

if TYPE_CHECKING:
    Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Targets:
    """The active targets of one picture, by id; row i of every array is the same target.

    Iterating gives pairs of id and box.
    """

    ids: npt.NDArray[np.int64]
    """Who it is, shape (n,); never used twice."""
    boxes: Floats
    """Left, top, width, height; pixels from 0, shape (n, 4)."""
    phases: list[str]
    """"initiated", "re-identified", "tracked", "occluded" or "lost"."""
    states: Floats
    """x, y, vx, vy, log scale, angle, shape (n, 6)."""
    covariances: Floats
    """Their covariances, shape (n, 6, 6)."""
    gazes: Floats
    """The chosen gazes, template units, shape (n, 2)."""
    visible: Floats
    """Share that no other target covers, 0 to 1, shape (n,)."""
    deficit: Floats
    """How much the evidence speaks against it being there, 0 to 2, shape (n,)."""
    scores: Floats
    """Score of the detection that was taken to be it; NaN where none was, shape (n,)."""

    def __len__(self) -> int:
        return len(self.ids)

    def __iter__(self) -> Iterator[tuple[int, Box]]:
        for target, box in zip(self.ids.tolist(), self.boxes.tolist()):
            yield target, Box(*box)

    @property
    def ok(self) -> npt.NDArray[np.bool_]:
        """Which boxes are results, rather than guesses, shape (n,)."""
        return np.array([phase != "lost" for phase in self.phases], dtype=bool)

    @property
    def xyxy(self) -> Floats:
        """Left, top, right, bottom, shape (n, 4)."""
        return np.concatenate([self.boxes[:, :2], self.boxes[:, :2] + self.boxes[:, 2:]], axis=1)

    def _repr_html_(self) -> str:
        from ._show import targets_html  # noqa: PLC0415: it needs this module

        return targets_html(self)

    def to_supervision(self) -> Any:
        """As ``supervision.Detections`` with ``tracker_id``; deficit and phase are in ``data``.

        Raises
        ------
        ImportError
            The package supervision is not installed.
        """
        import supervision  # noqa: PLC0415: optional

        return supervision.Detections(
            xyxy=self.xyxy,
            confidence=np.nan_to_num(self.scores, nan=0.0),
            class_id=np.zeros(len(self), dtype=int),
            tracker_id=self.ids.astype(int),
            data={"deficit": self.deficit, "phase": np.array(self.phases, dtype=object)},
        )
