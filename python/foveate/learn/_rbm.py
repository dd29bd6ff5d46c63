"""Restricted Boltzmann machines."""

from __future__ import annotations

import math
from typing import Any, Literal

from ._base import Density


class RBM(Density):
    """A restricted Boltzmann machine with binary hidden units, trained by contrastive divergence (section 2.1 of the paper).

    ``transform`` gives p(h = 1 | v), shape (n_samples, n_components).

    It passes scikit-learn's ``check_estimator`` with ``visible="gaussian"``. With ``visible="bernoulli"`` data must be from 0 to 1,
    and those of the checks are not.

    Parameters
    ----------
    n_components : int
        Hidden units.
    visible : {"gaussian", "bernoulli"}
        Real numbers of about unit variance, or numbers from 0 to 1.
    learning_rate : float, optional
        Step along the mean gradient of a batch. Default: 0.1 for ``"bernoulli"``, 0.01 for ``"gaussian"``, whose statistics have no bound.
    batch_size : int, optional
        Rows in a batch. Default: a 200th of the rows, 10 at least and 100 at most: enough updates in a pass for a small set, and large
        matrix products for a large one.
    n_iter : int, optional
        Passes over the data. Default: 15, or more if they make fewer than 3000 updates; with fewer the weights hardly leave 0.
    momentum, l2 : float
        0 to below 1; pull of the weights towards 0.
    chains : int
        0: contrastive divergence. Else persistent contrastive divergence with so many chains.
    gibbs_steps : int
        Gibbs steps a batch.
    random_state : int, RandomState or None
        Names all random numbers.

    Attributes
    ----------
    components_ : float32 array (n_components, n_features)
        Weights.
    intercept_hidden_ : float32 array (n_components,)
    intercept_visible_ : float32 array (n_features,)
    batch_size_, n_iter_ : int
        Rows in a batch and passes over the data, as they were in ``fit``.

    Examples
    --------
    >>> import numpy as np
    >>> bars = np.eye(8, dtype=np.float32)[np.random.default_rng(0).integers(0, 8, 400)]
    >>> rbm = RBM(n_components=8, visible="bernoulli", n_iter=30, batch_size=20, random_state=0).fit(bars)
    >>> rbm.transform(bars).shape
    (400, 8)
    >>> noise = np.random.default_rng(1).integers(0, 2, (400, 8))
    >>> bool(rbm.score_samples(bars).mean() > rbm.score_samples(noise).mean())
    True
    """

    _KIND = "rbm"
    _ATTRIBUTES = {"weights": "components_", "visible_bias": "intercept_visible_", "hidden_bias": "intercept_hidden_"}

    def __init__(
        self,
        n_components: int = 64,
        *,
        visible: Literal["gaussian", "bernoulli"] = "gaussian",
        learning_rate: float | None = None,
        batch_size: int | None = None,
        n_iter: int | None = None,
        momentum: float = 0.9,
        l2: float = 2e-4,
        chains: int = 0,
        gibbs_steps: int = 1,
        random_state: Any = None,
    ) -> None:
        self.n_components = n_components
        self.visible = visible
        self.learning_rate = learning_rate
        self.batch_size = batch_size
        self.n_iter = n_iter
        self.momentum = momentum
        self.l2 = l2
        self.chains = chains
        self.gibbs_steps = gibbs_steps
        self.random_state = random_state

    def _recipe_for(self, rows: int) -> dict[str, Any]:
        recipe = self._recipe()
        if self.batch_size is None:
            recipe["batch"] = min(max(rows // 200, 10), 100)
        if self.n_iter is None:
            recipe["epochs"] = max(15, math.ceil(3000 / math.ceil(rows / max(1, recipe["batch"]))))
        self.batch_size_, self.n_iter_ = min(recipe["batch"], rows), recipe["epochs"]
        return recipe

    def _recipe(self) -> dict[str, Any]:
        """Passes and batch size that depend on the rows are 1: a trained model needs neither."""
        usual = 0.1 if self.visible == "bernoulli" else 0.01
        steps, chains = self._count("gibbs_steps"), self._count("chains")
        return {
            "visible": self.visible,
            "hidden": self._count("n_components"),
            "epochs": 1 if self.n_iter is None else self._count("n_iter"),
            "batch": 1 if self.batch_size is None else self._count("batch_size"),
            "shuffle": True,
            "rate": usual if self.learning_rate is None else self._real("learning_rate"),
            "momentum": self._real("momentum"),
            "negative": {"persistent": {"chains": chains, "steps": steps}} if chains else {"contrastive": {"steps": steps}},
            "l2": self._real("l2"),
            "l1": 0.0,
            "initial_sd": 0.01,
        }

    @property
    def _n_features_out(self) -> int:
        return len(self.components_)
