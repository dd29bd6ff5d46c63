"""Filters of whitened rows by k-means."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._base import FeatureLearner, Singles


class SphericalKMeans(FeatureLearner):
    """Features by spherical k-means of whitened rows (Coates, Ng & Lee 2011; Coates & Ng 2012).

    Each row x is s times the one of the filters d_j, of length 1, that it fits best; the mean of the squared rest is made small.
    ``transform`` gives max(0, d_j . x - threshold), shape (n_samples, n_components); the largest names the cluster. It passes
    scikit-learn's ``check_estimator``.

    Parameters
    ----------
    n_components : int
        Filters, 1 to 4096, at most as many as rows; rows have at most 1024 values.
    threshold : float
        What a product must be above to count.
    n_iter, n_init : int
        Passes over the data; starts, of which that with the least cost is kept: more than one where filters are few.
    explained_variance : float
        Share of the rows' variance that whitening keeps, above 0, at most 1: 0.99 for patches of pictures.
    softening : float, optional
        For patches of pictures: each row loses its mean and is divided by sqrt(variance + softening). Rows stay as they are, if left out.
    random_state : int, RandomState or None
        Names all random numbers.

    Attributes
    ----------
    mean_, whitening_ : float32 arrays (n_features,), (n_white, n_features)
        A row v is whitened to x = (v - mean_) @ whitening_.T.
    filters_ : float32 array (n_components, n_white)
        d_j.
    components_ : float32 array (n_components, n_features)
        What the filters look like as rows: the whitening undone.
    cost_ : float
        What is made small, the mean over rows divided by n_white, before the last pass turned the filters.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> labels = rng.integers(0, 3, 300)
    >>> rows = np.array([[3, 0], [0, 3], [-3, -3]])[labels] + 0.3 * rng.normal(size=(300, 2))
    >>> found = SphericalKMeans(3, n_init=10, random_state=0).fit_transform(rows).argmax(axis=1)
    >>> len({*zip(labels.tolist(), found.tolist())})    # every cluster is one of those
    3
    """

    _KIND = "filters"
    _ATTRIBUTES = {"mean": "mean_", "whitening": "whitening_", "filters": "filters_"}

    def __init__(
        self,
        n_components: int = 64,
        *,
        threshold: float = 0.0,
        n_iter: int = 30,
        n_init: int = 1,
        explained_variance: float = 1.0,
        softening: float | None = None,
        random_state: Any = None,
    ) -> None:
        self.n_components = n_components
        self.threshold = threshold
        self.n_iter = n_iter
        self.n_init = n_init
        self.explained_variance = explained_variance
        self.softening = softening
        self.random_state = random_state

    def _features(self, codes: Singles) -> Singles:
        above: Singles = np.maximum(codes - np.float32(self._real("threshold")), 0)
        return above

    def _recipe(self) -> dict[str, Any]:
        return {
            "filters": self._count("n_components"),
            "epochs": self._count("n_iter"),
            "keep": self._real("explained_variance"),
            "softening": None if self.softening is None else self._real("softening"),
        }

    def _least(self) -> dict[str, int]:
        return {"ensure_min_samples": 2, "ensure_min_features": 1 if self.softening is None else 2}

    def _learned(self, rows: Singles, recipe: dict[str, Any], random: np.random.RandomState) -> dict[str, Singles]:
        starts = [super(SphericalKMeans, self)._learned(rows, recipe, random) for _ in range(max(1, self._count("n_init")))]
        best = min(starts, key=lambda tensors: float(tensors["cost"]))
        self.cost_ = float(best["cost"])
        return best

    @property
    def components_(self) -> Singles:
        """What the filters look like as rows: the whitening undone; float32, shape (n_filters, n_features)."""
        # Rows of the whitening are orthogonal.
        inverse = self.whitening_ / (self.whitening_**2).sum(axis=1, keepdims=True)
        found: Singles = self.filters_ @ inverse
        return found

    @property
    def _n_features_out(self) -> int:
        return len(self.filters_)
