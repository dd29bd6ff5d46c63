"""A particle filter with a model of your own.

>>> import numpy as np
>>> filter = ParticleFilter(
...     start=lambda n, rng: rng.normal(0, 1, (n, 1)),
...     transition=lambda x, rng: x + rng.normal(0, 0.1, x.shape),
...     log_likelihood=lambda x, y: -0.5 * ((y - x[:, 0]) / 0.5) ** 2,
...     particles=1000,
... )
>>> for y in (0.9, 1.1, 1.0):
...     seen = filter.update(y)
>>> bool(abs(seen.mean[0] - 0.9) < 0.2)
True
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from ._foveate import select
from .errors import InputError

Floats = npt.NDArray[np.float64]

__all__ = ["Belief", "ParticleFilter", "resample"]

Scheme = Literal["multinomial", "stratified", "systematic", "residual"]


class Belief(NamedTuple):
    """The belief after an observation."""

    mean: Floats
    """Shape (d,)."""
    covariance: Floats
    """Shape (d, d)."""
    ess: float
    """Effective sample size 1 / sum of squared weights, 1 to n."""
    log_evidence: float
    """Logarithm of p(observation | those before), nats, as the log-likelihood has it."""


def resample(
    weights: npt.ArrayLike, count: int | None = None, scheme: Scheme = "systematic", seed: int = 1, step: int = 0
) -> npt.NDArray[np.int64]:
    """For each of ``count`` places (default: as many as weights), the index of the particle that takes it; ascending.

    Every scheme is unbiased: particle i gets count * w_i places on average. ``seed`` and ``step`` name the draws.

    >>> resample([0.0, 0.5, 0.5], 4).tolist()
    [1, 1, 2, 2]
    """
    given = np.ascontiguousarray(weights, dtype=np.float64)
    if given.ndim != 1:
        raise InputError(f"weights are numbers in one row, shape (n,); they have the shape {given.shape}")
    return select(given, len(given) if count is None else count, scheme, seed, step)


class ParticleFilter:
    """A bootstrap filter: particles move by ``transition`` and are weighted by ``log_likelihood``.

    Parameters
    ----------
    start : callable (n, rng) -> array (n, d)
        Draws the first particles.
    transition : callable (particles (n, d), rng) -> array (n, d)
        Draws where each particle is in the next step.
    log_likelihood : callable (particles (n, d), observation) -> array (n,)
        log p(observation | particle); ``-inf`` is allowed, NaN is not.
    particles : int
        How many, n.
    scheme : str
        How places are given out: "systematic", "stratified", "residual" or "multinomial".
    below : float
        Resample while the effective sample size is below this share of the particles, 0 (never) to 1 (every step).
    seed : int
        Names all random numbers; ``rng`` is NumPy's generator.

    All three callables are called once a step with all particles: write them without loops.
    """

    particles: Floats
    """Shape (n, d)."""
    weights: Floats
    """Shape (n,); they sum to 1."""
    log_evidence: float
    """Sum over all observations."""

    def __init__(
        self,
        start: Callable[[int, np.random.Generator], Floats],
        transition: Callable[[Floats, np.random.Generator], Floats],
        log_likelihood: Callable[[Floats, Any], Floats],
        particles: int = 1000,
        scheme: Scheme = "systematic",
        below: float = 0.5,
        seed: int = 1,
    ) -> None:
        if particles < 1 or not 0 <= below <= 1:
            raise InputError(f"particles is at least 1 and below 0 to 1; they are {particles} and {below}")
        self._transition, self._log_likelihood = transition, log_likelihood
        self._scheme, self._below, self._seed = scheme, below, seed
        resample([1.0], 1, scheme, seed)  # raises the errors of these arguments at once
        self._rng, self._step = np.random.default_rng(seed), 0
        self.particles = self._checked("start", start(particles, self._rng), particles)
        self.weights = np.full(particles, 1 / particles)
        self.log_evidence = 0.0

    def update(self, observation: Any) -> Belief:
        """Moves the particles one step and weights them by an observation."""
        n = len(self.particles)
        ess = 1 / float(self.weights @ self.weights)
        if self._step > 0 and (self._below >= 1 or ess < self._below * n):
            self.particles = self.particles[resample(self.weights, n, self._scheme, self._seed, self._step)]
            self.weights = np.full(n, 1 / n)
        self._step += 1
        self.particles = self._checked("transition", self._transition(self.particles, self._rng), n)
        fit = np.asarray(self._log_likelihood(self.particles, observation), dtype=np.float64)
        if fit.shape != (n,) or np.isnan(fit).any() or (fit == np.inf).any():
            raise InputError(f"log_likelihood answers {n} numbers, shape ({n},), none of them NaN or +inf; it gave {fit.shape}, {np.atleast_1d(fit)[:3]}")
        fit = np.where(self.weights > 0, fit, -np.inf)  # one without weight has no say, however well it fits
        most = float(fit.max())
        if most == -np.inf:
            evidence = -np.inf  # no particle explains it: all weigh as before
        else:
            weights = self.weights * np.exp(fit - most)
            total = float(weights.sum())
            evidence, self.weights = most + float(np.log(total)), weights / total
        self.log_evidence += evidence
        mean = self.weights @ self.particles
        centred = self.particles - mean
        covariance = (self.weights[:, None] * centred).T @ centred
        return Belief(mean, covariance, 1 / float(self.weights @ self.weights), evidence)

    @staticmethod
    def _checked(name: str, particles: npt.ArrayLike, n: int) -> Floats:
        found = np.asarray(particles, dtype=np.float64)
        if found.ndim != 2 or len(found) != n or not np.isfinite(found).all():
            raise InputError(f"{name} answers finite numbers of shape ({n}, d); it gave {found.shape}")
        return found
