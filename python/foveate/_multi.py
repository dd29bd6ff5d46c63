"""Many targets in one picture, as arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._types import Box

if TYPE_CHECKING:
    Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Target:
    """One target of a picture."""

    id: int
    """Its number; never used twice."""
    box: Box
    """Left, top, width, height; pixels from 0."""
    phase: str
    """"initiated", "re-identified", "tracked", "occluded" or "lost"."""
    state: Floats
    """x, y, vx, vy, log scale, angle, log aspect, shape (7,)."""
    covariance: Floats
    """Its covariance, shape (7, 7)."""
    visible: float
    """Share that no other target covers, 0 to 1."""
    deficit: float
    """How much the evidence speaks against its being there, 0 to 2."""
    score: float
    """Score of the detection assigned to it; NaN where none was, or that has no score."""
    class_id: int
    """Class of its last detection that had one; -1 where none had."""
    name: str | None
    """Name of that class, where the detections have names."""
    detection_index: int
    """Row of the detection assigned to it, among those given to ``update``; -1 where none was."""

    @property
    def ok(self) -> bool:
        """Whether the box is a result, rather than a guess."""
        return self.phase != "lost"


@dataclass(frozen=True, eq=False)
class Targets:
    """The active targets of one picture, by id; row i of every array is the same target.

    Iterating gives pairs of id and box, ``targets[7]`` the target with the id 7, ``7 in targets`` whether there is one.
    """

    ids: npt.NDArray[np.int64]
    """Ids, shape (n,); never used twice."""
    boxes: Floats
    """Left, top, width, height; pixels from 0, shape (n, 4)."""
    phases: list[str]
    """"initiated", "re-identified", "tracked", "occluded" or "lost"."""
    states: Floats
    """x, y, vx, vy, log scale, angle, log aspect, shape (n, 7)."""
    covariances: Floats
    """Their covariances, shape (n, 7, 7)."""
    gazes: Floats
    """The chosen gazes, template units, shape (n, 2)."""
    visible: Floats
    """Share that no other target covers, 0 to 1, shape (n,)."""
    deficit: Floats
    """How much the evidence speaks against it being there, 0 to 2, shape (n,)."""
    scores: Floats
    """Score of the detection that was taken to be it; NaN where none was, or that has no score, shape (n,)."""
    class_ids: npt.NDArray[np.int64]
    """Class of its last detection that had one; -1 where none had, shape (n,)."""
    detection_index: npt.NDArray[np.int64]
    """Row of the detection assigned to it, among those given to ``update``; -1 where none was, shape (n,)."""
    names: list[str | None]
    """Name of its class, where the detections have names."""
    data: dict[str, Any] = field(default_factory=dict)
    """What came with the detections: arrays of n values by name, None for targets without a detection in this picture."""

    def __len__(self) -> int:
        return len(self.ids)

    def __iter__(self) -> Iterator[tuple[int, Box]]:
        for target, box in zip(self.ids.tolist(), self.boxes.tolist()):
            yield target, Box(*box)

    def __contains__(self, target: object) -> bool:
        return target in self.ids

    def __getitem__(self, target: int) -> Target:
        rows = np.flatnonzero(self.ids == target)
        if not len(rows):
            raise KeyError(f"no target {target}; there are {self.ids.tolist()}")
        i = int(rows[0])
        return Target(
            id=int(self.ids[i]),
            box=Box(*self.boxes[i].tolist()),
            phase=self.phases[i],
            state=self.states[i],
            covariance=self.covariances[i],
            visible=float(self.visible[i]),
            deficit=float(self.deficit[i]),
            score=float(self.scores[i]),
            class_id=int(self.class_ids[i]),
            name=self.names[i],
            detection_index=int(self.detection_index[i]),
        )

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

    def to_supervision(self, *, lost: bool = False) -> Any:
        """As ``supervision.Detections`` with ``tracker_id``, for results only unless ``lost``.

        ``class_id`` is the class of the target's last detection, and None where no target has one; ``confidence`` is the score of the
        detection of this picture, 0 without one, and None where no target has one. ``data`` has deficit, phase, detection_index,
        class_name where classes have names, and what came with the detections.

        Raises
        ------
        ImportError
            The package supervision is not installed.
        """
        import supervision  # noqa: PLC0415: optional

        shown = np.flatnonzero(self.ok | lost)
        data: dict[str, Any] = {name: np.asarray(values)[shown] for name, values in self.data.items()}
        data["deficit"] = self.deficit[shown]
        data["phase"] = np.array(self.phases, dtype=object)[shown]
        data["detection_index"] = self.detection_index[shown]
        if any(self.names):
            data["class_name"] = np.array([name or "" for name in self.names], dtype=object)[shown]
        scores, classes = self.scores[shown], self.class_ids[shown]
        return supervision.Detections(
            xyxy=self.xyxy[shown],
            confidence=None if np.isnan(scores).all() and len(scores) else np.nan_to_num(scores, nan=0.0),
            class_id=None if (classes < 0).all() and len(classes) else classes.astype(int),
            tracker_id=self.ids[shown].astype(int),
            data=data,
        )


def targets(arrays: dict[str, Any], names: dict[int, str], data: dict[str, Any]) -> Targets:
    """Targets of a picture, with the names of classes, and of ``data``, a value a detection, what belongs to each."""
    index = arrays["detection_index"]

    def carried(values: Any) -> npt.NDArray[np.object_]:
        out = np.full(len(index), None, dtype=object)
        for i, j in enumerate(index):
            if j >= 0:
                out[i] = values[j]
        return out

    named = [names.get(int(c)) for c in arrays["class_ids"]]
    return Targets(**arrays, names=named, data={name: carried(values) for name, values in data.items()})
