"""Softmax regression."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import ClassifierMixin
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, column_or_1d, validate_data

from .._foveate import softmax_fit
from ..errors import ConfigError, InputError
from ._base import Learner


class SoftmaxRegression(ClassifierMixin, Learner):  # type: ignore[misc]
    """Multinomial logistic regression by L-BFGS: the paper's classifier (section 2.2).

    It minimises the mean of -log p(y | x) over the rows, + 1/2 ||W||^2 / (C n_samples). scikit-learn's ``LogisticRegression`` with three
    classes or more has the same minimum, and the weights agree within 2e-3. For two classes there is a row of weights each here, so
    that the penalty is half as strong as there. Fits in float64, and passes scikit-learn's ``check_estimator``.

    Parameters
    ----------
    C : float
        Inverse strength of the penalty on the weights; above 0.
    max_iter : int
        The most steps of L-BFGS.
    tol : float
        Stops when no part of the gradient is larger than this, in units in which the curvature is about 1 at W = 0.

    Attributes
    ----------
    classes_ : array (n_classes,)
        2 to 256.
    coef_, intercept_ : float64 arrays (n_classes, n_features), (n_classes,)
    n_iter_ : int
        Steps taken.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> X, y = load_iris(return_X_y=True)
    >>> model = SoftmaxRegression().fit(X, y)
    >>> model.predict_proba(X).shape, bool(model.score(X, y) > 0.95)
    ((150, 3), True)
    """

    def __init__(self, C: float = 1.0, *, max_iter: int = 1000, tol: float = 1e-7) -> None:
        self.C = C
        self.max_iter = max_iter
        self.tol = tol

    def fit(self, X: npt.ArrayLike, y: npt.ArrayLike, sample_weight: npt.ArrayLike | None = None) -> SoftmaxRegression:
        """Learns from the rows of X, shape (n_samples, n_features), and their labels y, shape (n_samples,).

        A row with the weight 2 counts as two rows, one with 0 does not count; ``sample_weight`` has shape (n_samples,), and n_samples in
        the cost is its sum. Warns with ``ConvergenceWarning`` if ``max_iter`` steps were too few.
        """
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        inverse, steps, tolerance = self._real("C"), self._count("max_iter"), self._real("tol")
        if inverse <= 0 or steps == 0 or tolerance < 0:
            raise ConfigError(f"SoftmaxRegression: C is above 0, max_iter at least 1, tol at least 0; got {inverse}, {steps}, {tolerance}")
        self._singles(rows)
        self.classes_, indices = np.unique(column_or_1d(labels, warn=True), return_inverse=True)
        count = len(self.classes_)
        if not 2 <= count <= 256:
            raise InputError(f"SoftmaxRegression needs 2 to 256 classes; y has {count} class{'es' * (count != 1)}")
        weights = None if sample_weight is None else _check_sample_weight(sample_weight, rows, dtype=np.float64, ensure_non_negative=True)
        total = float(len(rows) if weights is None else weights.sum())
        if total == 0:
            raise InputError("SoftmaxRegression: sample_weight has a number above 0 at least; all are 0")
        found, self.intercept_, self.n_iter_, converged = softmax_fit(
            rows, indices.astype(np.uint8), weights, count, 1 / (inverse * total), steps, tolerance
        )
        self.coef_ = np.ascontiguousarray(found.T)
        if not converged:
            warnings.warn(f"after {steps} steps it has not converged: raise max_iter or scale X", ConvergenceWarning, stacklevel=2)
        return self

    def predict_log_proba(self, X: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """log p(y | x), nats, of each row and class: shape (n_samples, n_classes)."""
        check_is_fitted(self)
        scores = validate_data(self, X, dtype=np.float64, reset=False) @ self.coef_.T + self.intercept_
        scores -= scores.max(axis=1, keepdims=True)
        log_p: npt.NDArray[np.float64] = scores - np.log(np.exp(scores).sum(axis=1, keepdims=True))
        return log_p

    def predict_proba(self, X: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """p(y | x) of each row and class: shape (n_samples, n_classes)."""
        return np.exp(self.predict_log_proba(X))

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """The likeliest class of each row: shape (n_samples,)."""
        likeliest = self.predict_log_proba(X).argmax(axis=1)
        labels: npt.NDArray[Any] = self.classes_[likeliest]
        return labels
