"""Restricted Boltzmann machines."""

from __future__ import annotations

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
    learning_rate : float
        Step along the mean gradient of a batch.
    batch_size, n_iter : int
        Rows in a batch; passes over the data.
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
        learning_rate: float = 0.01,
        batch_size: int = 100,
        n_iter: int = 15,
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

    def _recipe(self) -> dict[str, Any]:
        steps, chains = self._count("gibbs_steps"), self._count("chains")
        return {
            "visible": self.visible,
            "hidden": self._count("n_components"),
            "epochs": self._count("n_iter"),
            "batch": self._count("batch_size"),
            "shuffle": True,
            "rate": self._real("learning_rate"),
            "momentum": self._real("momentum"),
            "negative": {"persistent": {"chains": chains, "steps": steps}} if chains else {"contrastive": {"steps": steps}},
            "l2": self._real("l2"),
            "l1": 0.0,
            "initial_sd": 0.01,
        }

    @property
    def _n_features_out(self) -> int:
        return len(self.components_)
