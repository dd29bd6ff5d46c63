"""The mean and covariance machine."""

from __future__ import annotations

from typing import Any, Literal

from ._base import Density


class FactoredRBM(Density):
    """A factored RBM with mean and covariance units, the mcRBM of Ranzato & Hinton (2010), trained by hybrid Monte Carlo.

    Covariance units see which relations between values hold, mean units what the values are; rows are whitened first. ``transform`` gives
    p(covariance unit is off | v), then p(mean unit is on | v), shape (n_samples, n_covariance + n_means). That a unit is off means that
    a relation is broken, which is rare, and says what is there. It passes scikit-learn's ``check_estimator``.

    Parameters
    ----------
    n_factors : int
        Factors, 1 to 2048; with ``pooling="grid"`` the square of an even number from 4.
    n_means : int
        Mean units, 1 to 2048.
    pooling : {"single", "grid"}
        A covariance unit for each factor; or for each 3 x 3 neighbours of a square of factors, a quarter as many: neighbours become alike.
    explained_variance : float
        Share of the rows' variance that whitening keeps, above 0, at most 1.
    learning_rate : float
        Step along the mean gradient of a batch.
    batch_size, n_iter : int
        Rows in a batch, those that do not fill one wait for the next pass; passes over the data.
    persistent : bool
        Whether the model's own rows go on from batch to batch; else they begin at the rows of the batch (contrastive divergence).
    leapfrog_steps : int
        Of a proposal of hybrid Monte Carlo.
    rejection_rate : float
        Share of proposals to be rejected, between 0 and 1: the length of steps follows.
    anneal : int
        Passes after which the learning rate falls.
    l1, l1_from : float, int
        Pull of the filters towards 0, of constant size; from which pass on.
    pool_from : int, optional
        From which pass on what units pool is learned, too; never, if left out.
    random_state : int, RandomState or None
        Names all random numbers.

    Attributes
    ----------
    mean_, whitening_ : float32 arrays (n_features,), (n_white, n_features)
        A row v is whitened to (v - mean_) @ whitening_.T.
    factors_ : float32 array (n_factors, n_white)
        Filters of the factors, of whitened rows.
    pooling_ : float32 array (n_covariance, n_factors)
        Which factors a covariance unit sees; not negative.
    components_ : float32 array (n_means, n_white)
        Filters of the mean units, of whitened rows.
    intercept_covariance_, intercept_mean_, intercept_visible_ : float32 arrays (n_covariance,), (n_means,), (n_white,)

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> volume = rng.exponential(size=(2000, 2))                        # two pairs, each loud or silent together
    >>> rows = np.repeat(volume, 2, axis=1) * rng.normal(size=(2000, 4))
    >>> machine = FactoredRBM(n_factors=8, n_means=2, n_iter=20, random_state=0).fit(rows)
    >>> machine.transform(rows).shape
    (2000, 10)
    >>> bool(machine.score_samples(rows).mean() > machine.score_samples(rng.permuted(rows, axis=0)).mean())
    True
    """

    _KIND = "factored"
    _ATTRIBUTES = {
        "whitening.mean": "mean_",
        "whitening.matrix": "whitening_",
        "filters": "factors_",
        "pooling": "pooling_",
        "covariance_bias": "intercept_covariance_",
        "weights": "components_",
        "mean_bias": "intercept_mean_",
        "visible_bias": "intercept_visible_",
    }

    def __init__(
        self,
        n_factors: int = 64,
        n_means: int = 64,
        *,
        pooling: Literal["single", "grid"] = "single",
        explained_variance: float = 0.99,
        learning_rate: float = 0.075,
        batch_size: int = 128,
        n_iter: int = 50,
        persistent: bool = True,
        leapfrog_steps: int = 20,
        rejection_rate: float = 0.1,
        anneal: int = 20,
        l1: float = 0.001,
        l1_from: int = 10,
        pool_from: int | None = None,
        random_state: Any = None,
    ) -> None:
        self.n_factors = n_factors
        self.n_means = n_means
        self.pooling = pooling
        self.explained_variance = explained_variance
        self.learning_rate = learning_rate
        self.batch_size = batch_size
        self.n_iter = n_iter
        self.persistent = persistent
        self.leapfrog_steps = leapfrog_steps
        self.rejection_rate = rejection_rate
        self.anneal = anneal
        self.l1 = l1
        self.l1_from = l1_from
        self.pool_from = pool_from
        self.random_state = random_state

    def _least(self) -> dict[str, int]:
        return {"ensure_min_samples": 2}

    def _recipe(self) -> dict[str, Any]:
        return {
            "factors": self._count("n_factors"),
            "pooling": self.pooling,
            "means": self._count("n_means"),
            "keep": self._real("explained_variance"),
            "epochs": self._count("n_iter"),
            "batch": self._count("batch_size"),
            "rate": self._real("learning_rate"),
            "anneal": self._count("anneal"),
            "negative": "persistent" if self.persistent else "contrastive",
            "leapfrog_steps": self._count("leapfrog_steps"),
            "rejection": self._real("rejection_rate"),
            "settle": self._count("l1_from"),
            "learn_pooling": None if self.pool_from is None else self._count("pool_from"),
            "l1": self._real("l1"),
        }

    @property
    def _n_features_out(self) -> int:
        return len(self.intercept_covariance_) + len(self.intercept_mean_)
