"""Bandits over gazes, or over anything else: ``ask`` for one, ``tell`` what it was worth.

They are the policies of the tracker (docs/paper.md has their equations), and know nothing of tracking.

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

from ._foveate import Policy
from .errors import ConfigError, InputError

Floats = npt.NDArray[np.float64]

__all__ = ["Exp3", "GpUcb", "Hedge"]


class _Bandit:
    """What all have: pickles, and settings to be shown."""

    _policy: Policy
    _made: dict[str, Any]

    def _make(self, kind: str, arms: int, settings: dict[str, Any], seed: int) -> None:
        self._made = {"kind": kind, "arms": arms, "settings": settings, "seed": seed}
        gazes = [(float(arm), 0.0) for arm in range(arms)]
        try:
            text = json.dumps(settings, allow_nan=False, default=_plain)
        except (TypeError, ValueError):
            raise ConfigError(f"{kind}: settings are finite numbers, strings or true and false; they are {settings}") from None
        self._policy = Policy(kind, gazes, text, seed)

    def __getstate__(self) -> dict[str, Any]:
        return {"made": self._made, "saved": self._policy.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._make(**state["made"])
        self._policy.load(*state["saved"])

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._made['settings']}, seed={self._made['seed']})"


class _Arms(_Bandit):
    """Those that choose among a few."""

    def __init__(self, kind: str, arms: int, gamma: float | None, frames: int | None, seed: int) -> None:
        if gamma is not None and frames is not None:
            raise InputError("give gamma, a rate, or frames, the number of steps that the best rate is for, not both")
        rate: Any = gamma if gamma is not None else "anytime" if frames is None else {"frames": frames}
        self._make(kind, arms, {"gamma": rate}, seed)

    @property
    def probabilities(self) -> Floats:
        """How likely each arm is to be chosen next; shape (k,), sums to 1."""
        found = self._policy.probabilities()
        assert found is not None, "a policy with arms shows them"
        return found

    def ask(self) -> int:
        """The arm to choose now, from 0."""
        arm, _, _ = self._policy.ask()
        assert arm is not None, "a policy with arms answers one"
        self._asked = arm
        return arm


class Hedge(_Arms):
    """Full information: it is told what every arm would have been worth (section 4.2 of the paper).

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
        """What each arm was worth, 0 to 1; shape (k,). One call after each ``ask``."""
        self._policy.tell(_rewards(rewards))


class Exp3(_Arms):
    """Partial information: it is told what the chosen arm was worth (section 4.3; Auer et al. 2002).

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
        """What the arm that was asked for is worth, 0 to 1."""
        if arm != getattr(self, "_asked", arm):
            raise InputError(f"EXP3 learns from the arm that ask answered, {self._asked}; it was told of arm {arm}")
        self._policy.tell(_rewards([reward]))


class GpUcb(_Bandit):
    """Bayesian optimisation of a point of a square: a Gaussian process and an upper confidence bound (section 4.4).

    Parameters
    ----------
    reach : float
        Half the side of the square of points about (0, 0), above 0 to 10.
    seed : int
        Names all draws.
    settings
        Any key of ``policy = { kind = "gp-ucb" }`` (docs/configuration.md): window, warm_up, start, refit, evaluations, ...

    Examples
    --------
    >>> bandit = GpUcb(reach=1.0, start=1.0)
    >>> for _ in range(40):
    ...     u, v = bandit.ask()
    ...     bandit.tell((u, v), 1 - (u - 0.3) ** 2 - (v + 0.2) ** 2)
    >>> u, v = bandit.best
    >>> abs(u - 0.3) < 0.1 and abs(v + 0.2) < 0.1
    True
    """

    def __init__(self, reach: float = 0.5, seed: int = 1, **settings: Any) -> None:
        self._make("gp-ucb", 0, {"reach": reach, **settings}, seed)

    def ask(self) -> tuple[float, float]:
        """The point to try now."""
        _, u, v = self._policy.ask()
        return u, v

    def tell(self, point: Sequence[float], reward: float) -> None:
        """What a point is worth, from -1e100 to 1e100: one that was asked for, or another."""
        u, v = (float(x) for x in point)
        reach = self._made["settings"]["reach"]
        if not (abs(u) <= reach and abs(v) <= reach):
            raise InputError(f"the point lies within {reach} of (0, 0) along each axis; it is ({u}, {v})")
        if not abs(reward) <= 1e100:
            raise InputError(f"a reward is a number from -1e100 to 1e100; it is {reward}")
        self._policy.tell_of(u, v, float(reward))

    @property
    def best(self) -> tuple[float, float] | None:
        """The point with the largest mean; ``None`` before anything was learned."""
        return self._policy.best()

    def predict(self, points: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Mean and standard deviation of the believed reward at points of shape (n, 2); two arrays of shape (n,)."""
        rows = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        found = self._policy.predict([(u, v) for u, v in rows.tolist()])
        assert found is not None, "a policy with a surface shows it"
        return found


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
