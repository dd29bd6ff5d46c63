"""Bandits: ``ask`` for an arm or a point, ``tell`` the reward.

``Hedge`` and ``Exp3`` are the tracker's policies (docs/paper.md has their equations), ``GpUcb`` is Bayesian optimisation of a box of up
to 14 dimensions with the tracker's Gaussian process. None needs a tracker.

>>> bandit = Exp3(3, frames=200)
>>> for _ in range(200):
...     arm = bandit.ask()
...     bandit.tell(arm, 1.0 if arm == 2 else 0.2)
>>> int(bandit.probabilities.argmax())
2
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ._foveate import Optimiser, Policy
from .errors import ConfigError, InputError

Floats = npt.NDArray[np.float64]

__all__ = ["Exp3", "GpUcb", "Hedge"]


class _Arms:
    """Choose among a few arms."""

    _policy: Policy
    _made: dict[str, Any]

    def __init__(self, kind: str, arms: int, gamma: float | None, frames: int | None, seed: int) -> None:
        if gamma is not None and frames is not None:
            raise InputError("give gamma, a rate, or frames, the number of steps that the best rate is for, not both")
        rate: Any = gamma if gamma is not None else "anytime" if frames is None else {"frames": frames}
        self._make(kind, arms, rate, seed)

    def _make(self, kind: str, arms: int, rate: Any, seed: int) -> None:
        self._made = {"kind": kind, "arms": arms, "rate": rate, "seed": seed}
        self._policy = Policy(kind, arms, _json(kind, rate), seed)

    def __getstate__(self) -> dict[str, Any]:
        return {"made": self._made, "saved": self._policy.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._make(**state["made"])
        self._policy.load(*state["saved"])

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._made['arms']}, gamma={self._made['rate']!r}, seed={self._made['seed']})"

    @property
    def probabilities(self) -> Floats:
        """Probability of choosing each arm next; shape (k,), sums to 1."""
        found = self._policy.probabilities()
        assert found is not None, "a policy with arms shows them"
        return found

    def ask(self) -> int:
        """The arm to choose now, from 0."""
        self._asked = self._policy.ask()
        return self._asked


class Hedge(_Arms):
    """Full information: it receives the reward of every arm (section 4.2 of the paper).

    Its regret against the best single arm over T steps is at most sqrt(T ln k / 2), whatever the rewards.

    Parameters
    ----------
    arms : int
        How many there are, k.
    gamma : float, optional
        The learning rate, above 0.
    frames : int, optional
        Instead: the rate with the best bound over so many steps. Neither: a rate that falls, for any number.
    seed : int
        Names all draws.
    """

    def __init__(self, arms: int, gamma: float | None = None, frames: int | None = None, seed: int = 1) -> None:
        super().__init__("hedge", arms, gamma, frames, seed)

    def tell(self, rewards: npt.ArrayLike) -> None:
        """Takes the reward of each arm, 0 to 1; shape (k,). One call after each ``ask``."""
        self._policy.tell(_rewards(rewards))


class Exp3(_Arms):
    """Partial information: it receives the reward of the chosen arm (section 4.3; Auer et al. 2002).

    Its expected regret against the best single arm over T steps is at most 2 sqrt((e - 1) T k ln k).

    Parameters
    ----------
    arms, gamma, frames, seed
        As in :class:`Hedge`; gamma is the share of exploration, above 0 to 1.
    implicit : bool
        EXP3-IX (Neu 2015): explores by damping estimates instead of drawing at random.
    """

    def __init__(
        self,
        arms: int,
        gamma: float | None = None,
        frames: int | None = None,
        implicit: bool = False,
        seed: int = 1,
    ) -> None:
        super().__init__("exp3-ix" if implicit else "exp3", arms, gamma, frames, seed)

    def tell(self, arm: int, reward: float) -> None:
        """Takes the reward of the chosen arm, 0 to 1."""
        if arm != getattr(self, "_asked", arm):
            raise InputError(f"EXP3 learns from the arm that ask returned, {self._asked}; tell was called with arm {arm}")
        self._policy.tell(_rewards([reward]))


class GpUcb:
    """Bayesian optimisation of a point of a box: a Gaussian process and an upper confidence bound (GP-UCB; Srinivas et al. 2010).

    The process has a Matern 5/2 kernel with a length scale for each dimension, fitted as rewards arrive (MAP). The first points are a Latin
    hypercube; each later one maximises mean + kappa * deviation by DIRECT and quasi-Newton steps, where kappa cycles through 2, 1 and
    0.1. Rewards may have noise. The tracker's policy of the same name moves a gaze in a square and differs in its schedule
    (docs/configuration.md).

    Parameters
    ----------
    bounds : sequence of (float, float), optional
        The smallest and largest value of each dimension; 1 to 14 dimensions.
    seed : int
        Names all draws.
    reach : float
        Without bounds: half the side of a square about (0, 0); above 0.
    settings
        ``window``: rewards remembered, the newest, 2 to 2000 (300). ``warm_up``: points before the process is used (twice the dimensions
        and 3). ``evaluations``: points at which DIRECT reads the bound for each point proposed (1000).

    Examples
    --------
    >>> bandit = GpUcb([(-1, 1), (0, 10), (0, 10)])
    >>> for _ in range(40):
    ...     x = bandit.ask()
    ...     bandit.tell(x, 1 - (x[0] - 0.3) ** 2 - (x[1] - 2) ** 2 - (x[2] - 7) ** 2)
    >>> x = bandit.best
    >>> abs(x[0] - 0.3) < 0.1 and abs(x[1] - 2) < 0.1 and abs(x[2] - 7) < 0.1
    True
    """

    def __init__(self, bounds: Sequence[tuple[float, float]] | None = None, seed: int = 1, *, reach: float = 0.5, **settings: Any) -> None:
        pairs = [(-reach, reach)] * 2 if bounds is None else [(float(low), float(high)) for low, high in bounds]
        self._make(pairs, settings, seed)

    def _make(self, bounds: list[tuple[float, float]], settings: dict[str, Any], seed: int) -> None:
        self._made: dict[str, Any] = {"bounds": bounds, "settings": settings, "seed": seed}
        self._optimiser = Optimiser(bounds, _json("GpUcb", settings), seed)

    def __getstate__(self) -> dict[str, Any]:
        return {"made": self._made, "saved": self._optimiser.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._make(**state["made"])
        self._optimiser.load(state["saved"])

    def __repr__(self) -> str:
        given = "".join(f", {name}={value!r}" for name, value in self._made["settings"].items())
        return f"GpUcb({self._made['bounds']}, seed={self._made['seed']}{given})"

    def ask(self) -> tuple[float, ...]:
        """The point to try now, a number for each dimension."""
        return tuple(self._optimiser.ask())

    def tell(self, point: Sequence[float], reward: float) -> None:
        """The reward of a point, from -1e100 to 1e100: of a point from ``ask``, or of another within the bounds."""
        self._optimiser.tell([float(x) for x in point], float(reward))

    @property
    def best(self) -> tuple[float, ...] | None:
        """The point with the largest mean among those that were tried; ``None`` before the first reward."""
        found = self._optimiser.best()
        return None if found is None else tuple(found)

    def predict(self, points: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Mean and standard deviation of the reward at points of shape (n, dimensions); two arrays of shape (n,)."""
        rows = np.atleast_2d(np.asarray(points, dtype=np.float64))
        return self._optimiser.predict(rows)


def _json(kind: str, settings: Any) -> str:
    try:
        return json.dumps(settings, allow_nan=False, default=_plain)
    except (TypeError, ValueError):
        raise ConfigError(f"{kind}: settings are finite numbers, strings or true and false; they are {settings}") from None


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError


def _rewards(rewards: npt.ArrayLike) -> list[float]:
    found = np.asarray(rewards, dtype=np.float64).ravel()
    if not ((found >= 0) & (found <= 1)).all():
        raise InputError(f"rewards are from 0 to 1; they are {found.tolist()}")
    values: list[float] = found.tolist()
    return values
