"""Softmax regression."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import ClassifierMixin
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, column_or_1d, validate_data

from .._foveate import softmax_fit, softmax_log_probabilities
from ..errors import ConfigError, InputError
from ._base import Learner


class SoftmaxRegression(ClassifierMixin, Learner):  # type: ignore[misc]
    """Multinomial logistic regression by L-BFGS: the paper's classifier (section 2.2).

    The mean of -log p(y | x) + 1/2 ||W||^2 / (C n_samples) is made small, as scikit-learn's ``LogisticRegression`` does with three classes
    or more; two classes have a row of weights each here, which meets half the penalty. It passes scikit-learn's ``check_estimator``.

    Parameters
    ----------
    C : float
        Inverse of the pull of the weights towards 0; above 0.
    max_iter : int
        Steps of L-BFGS, at most.
    tol : float
        It ends where no part of the gradient is larger than this.

    Attributes
    ----------
    classes_ : array (n_classes,)
        2 to 256.
    coef_, intercept_ : float32 arrays (n_classes, n_features), (n_classes,)
    n_iter_ : int
        Steps that were taken.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> X, y = load_iris(return_X_y=True)
    >>> model = SoftmaxRegression().fit(X, y)
    >>> model.predict_proba(X).shape, bool(model.score(X, y) > 0.95)
    ((150, 3), True)
    """

    def __init__(self, C: float = 1.0, *, max_iter: int = 200, tol: float = 1e-5) -> None:
        self.C = C
        self.max_iter = max_iter
        self.tol = tol

    def fit(self, X: npt.ArrayLike, y: npt.ArrayLike) -> SoftmaxRegression:
        """Learns from the rows of X, shape (n_samples, n_features), and their labels y, shape (n_samples,).

        Warns with ``ConvergenceWarning`` where ``max_iter`` steps were too few.
        """
        rows, labels = validate_data(self, X, y, dtype=(np.float64, np.float32))
        check_classification_targets(labels)
        inverse, steps, tolerance = self._real("C"), self._count("max_iter"), self._real("tol")
        if inverse <= 0 or steps == 0 or tolerance < 0:
            raise ConfigError(f"SoftmaxRegression: C is above 0, max_iter at least 1, tol at least 0; got {inverse}, {steps}, {tolerance}")
        self.classes_, indices = np.unique(column_or_1d(labels, warn=True), return_inverse=True)
        count = len(self.classes_)
        if not 2 <= count <= 256:
            raise InputError(f"SoftmaxRegression needs 2 to 256 classes; y has {count} class{'es' * (count != 1)}")
        weights, self.intercept_, self.n_iter_ = softmax_fit(
            self._singles(rows), indices.astype(np.uint8), count, 1 / (inverse * len(rows)), steps, tolerance
        )
        self.coef_ = np.ascontiguousarray(weights.T)
        if self.n_iter_ == steps:
            warnings.warn(f"after {steps} steps it has not converged: raise max_iter or scale X", ConvergenceWarning, stacklevel=2)
        return self

    def predict_log_proba(self, X: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """log p(y | x), nats, of each row and class: shape (n_samples, n_classes)."""
        check_is_fitted(self)
        rows, _ = self._rows(X, reset=False)
        return softmax_log_probabilities(np.ascontiguousarray(self.coef_.T), self.intercept_, rows)

    def predict_proba(self, X: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """p(y | x) of each row and class: shape (n_samples, n_classes)."""
        return np.exp(self.predict_log_proba(X))

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """The likeliest class of each row: shape (n_samples,)."""
        likeliest = self.predict_log_proba(X).argmax(axis=1)
        labels: npt.NDArray[Any] = self.classes_[likeliest]
        return labels
