"""Learners of first-layer features, with scikit-learn's protocol. scikit-learn is needed: ``pip install scikit-learn``."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassNamePrefixFeaturesOutMixin, TransformerMixin  # type: ignore[import-untyped]
from sklearn.utils import check_random_state  # type: ignore[import-untyped]
from sklearn.utils.validation import check_is_fitted, validate_data  # type: ignore[import-untyped]

from ._foveate import rbm_fit, rbm_free_energy, rbm_hidden

Singles = npt.NDArray[np.float32]

__all__ = ["RBM"]


class RBM(ClassNamePrefixFeaturesOutMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """A restricted Boltzmann machine with binary hidden units, trained by contrastive divergence (section 2.1 of the paper).

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

    def fit(self, X: npt.ArrayLike, y: object = None) -> RBM:
        """Learns from the rows of X, shape (n_samples, n_features)."""
        del y
        rows = validate_data(self, X, dtype=(np.float64, np.float32))
        seed = int(check_random_state(self.random_state).randint(2**31 - 1))
        weights, visible, hidden = rbm_fit(
            np.ascontiguousarray(rows, dtype=np.float32),
            self.visible,
            self.n_components,
            self.n_iter,
            self.batch_size,
            self.learning_rate,
            self.momentum,
            self.l2,
            self.chains,
            self.gibbs_steps,
            seed,
        )
        self.components_ = np.ascontiguousarray(weights.T)
        self.intercept_visible_, self.intercept_hidden_ = visible, hidden
        self._n_features_out = self.n_components
        return self

    def transform(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """p(h = 1 | v) for each row; shape (n_samples, n_components), of X's type of floats."""
        rows, machine = self._checked(X)
        hidden = rbm_hidden(np.ascontiguousarray(rows, dtype=np.float32), self.visible, *machine)
        return hidden.astype(rows.dtype, copy=False)

    def score_samples(self, X: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """log p(v) of each row, nats, up to a constant that is the same for all: minus the free energy; shape (n_samples,)."""
        rows, machine = self._checked(X)
        return -rbm_free_energy(np.ascontiguousarray(rows, dtype=np.float32), self.visible, *machine)

    def _checked(self, X: npt.ArrayLike) -> tuple[npt.NDArray[Any], tuple[Singles, Singles, Singles]]:
        check_is_fitted(self)
        rows = validate_data(self, X, reset=False, dtype=(np.float64, np.float32))
        return rows, (np.ascontiguousarray(self.components_.T), self.intercept_visible_, self.intercept_hidden_)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.transformer_tags.preserves_dtype = ["float64", "float32"]
        return tags
