"""A denoising autoencoder."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.utils.validation import check_array, check_is_fitted

from ._base import FeatureLearner


class Autoencoder(FeatureLearner):
    """A denoising autoencoder with tied weights (Vincent et al. 2008): it learns to undo noise on its rows.

    h = sigmoid(W v + c) of a row v with noise, and W' h + b, which shall be the row without: the mean of half the squared error is made
    small by stochastic gradient descent. ``transform`` gives h of rows as they are, shape (n_samples, n_components), 0 to 1. It passes
    scikit-learn's ``check_estimator``.

    Parameters
    ----------
    n_components : int
        Hidden units, 1 to 65536.
    mask : float
        Share of a row's values that noise sets to 0; 0 to below 1.
    noise : float
        Standard deviation of the noise on the others, for values of about unit variance.
    learning_rate : float
        Step along the mean gradient of a batch.
    batch_size, n_iter : int
        Rows in a batch, those that do not fill one wait for the next pass; passes over the data.
    momentum, l2 : float
        0 to below 1; pull of the weights towards 0.
    random_state : int, RandomState or None
        Names all random numbers.

    Attributes
    ----------
    components_ : float32 array (n_components, n_features)
        Weights W.
    intercept_hidden_ : float32 array (n_components,)
        c.
    intercept_visible_ : float32 array (n_features,)
        b.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> rows = rng.normal(size=(1000, 2)) @ rng.normal(size=(2, 10))    # of ten values two are free
    >>> coder = Autoencoder(n_components=20, n_iter=100, mask=0.1, noise=0.1, l2=0, random_state=0).fit(rows)
    >>> bool(((coder.inverse_transform(coder.transform(rows)) - rows) ** 2).mean() < 0.05 * rows.var())
    True
    """

    _KIND = "autoencoder"
    _ATTRIBUTES = {"weights": "components_", "visible_bias": "intercept_visible_", "hidden_bias": "intercept_hidden_"}

    def __init__(
        self,
        n_components: int = 64,
        *,
        mask: float = 0.3,
        noise: float = 0.5,
        learning_rate: float = 0.5,
        batch_size: int = 100,
        n_iter: int = 30,
        momentum: float = 0.9,
        l2: float = 1e-3,
        random_state: Any = None,
    ) -> None:
        self.n_components = n_components
        self.mask = mask
        self.noise = noise
        self.learning_rate = learning_rate
        self.batch_size = batch_size
        self.n_iter = n_iter
        self.momentum = momentum
        self.l2 = l2
        self.random_state = random_state

    def inverse_transform(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """The rows that features stand for: shape (n_samples, n_features) of X of shape (n_samples, n_components)."""
        check_is_fitted(self)
        rows: npt.NDArray[Any] = check_array(X, dtype=(np.float64, np.float32)) @ self.components_ + self.intercept_visible_
        return rows

    def _recipe(self) -> dict[str, Any]:
        return {
            "hidden": self._count("n_components"),
            "epochs": self._count("n_iter"),
            "batch": self._count("batch_size"),
            "rate": self._real("learning_rate"),
            "momentum": self._real("momentum"),
            "mask": self._real("mask"),
            "noise": self._real("noise"),
            "l2": self._real("l2"),
        }

    @property
    def _n_features_out(self) -> int:
        return len(self.components_)
