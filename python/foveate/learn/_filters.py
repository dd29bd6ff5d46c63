"""Filters of whitened rows: k-means, sparse coding, independent subspaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.utils.validation import check_array, check_is_fitted

from ._base import FeatureLearner, Singles


class _Filters(FeatureLearner):
    """Rows are whitened, and met by filters."""

    _KIND = "filters"
    _ATTRIBUTES = {"mean": "mean_", "whitening": "whitening_", "filters": "filters_"}

    def __init__(
        self, n_components: int, n_iter: int, n_init: int, explained_variance: float, softening: float | None, random_state: Any
    ) -> None:
        self.n_components = n_components
        self.n_iter = n_iter
        self.n_init = n_init
        self.explained_variance = explained_variance
        self.softening = softening
        self.random_state = random_state

    def _recipe(self) -> dict[str, Any]:
        return {
            "method": self._method(),
            "filters": self._count("n_components") * self._size(),
            "epochs": self._count("n_iter"),
            "keep": self._real("explained_variance"),
            "softening": None if self.softening is None else self._real("softening"),
        }

    def _least(self) -> dict[str, int]:
        return {"ensure_min_samples": 2, "ensure_min_features": 1 if self.softening is None else 2}

    def _learned(self, rows: Singles, recipe: dict[str, Any], random: np.random.RandomState) -> dict[str, Singles]:
        starts = [super(_Filters, self)._learned(rows, recipe, random) for _ in range(max(1, self._count("n_init")))]
        best = min(starts, key=lambda tensors: float(tensors["cost"]))
        self.cost_ = float(best["cost"])
        return best

    def _method(self) -> dict[str, Any]:
        raise NotImplementedError

    def _size(self) -> int:
        """Filters of a feature."""
        return 1

    @property
    def components_(self) -> Singles:
        """What the filters look like as rows: the whitening undone; float32, shape (n_filters, n_features)."""
        # Rows of the whitening are orthogonal.
        inverse = self.whitening_ / (self.whitening_**2).sum(axis=1, keepdims=True)
        found: Singles = self.filters_ @ inverse
        return found

    @property
    def _n_features_out(self) -> int:
        return len(self.filters_) // self._size()


class SphericalKMeans(_Filters):
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
        super().__init__(n_components, n_iter, n_init, explained_variance, softening, random_state)
        self.threshold = threshold

    def _method(self) -> dict[str, Any]:
        return {"kind": "kmeans"}

    def _features(self, codes: Singles) -> Singles:
        above: Singles = np.maximum(codes - np.float32(self._real("threshold")), 0)
        return above


class SparseCoding(_Filters):
    """Sparse coding of whitened rows (Olshausen & Field 1996): a row is a sum of few filters.

    The mean of 1/2 ||x - s D||^2 + alpha ||s||_1 is made small, with filters, the rows of D, of length 1 at most: codes by coordinate
    descent, then filters (Mairal et al. 2009). ``transform`` gives the codes s, shape (n_samples, n_components). It passes scikit-learn's
    ``check_estimator``.

    Parameters
    ----------
    n_components : int
        Filters, 1 to 4096, at most as many as rows; rows have at most 1024 values.
    alpha : float
        What a unit of a code costs, above 0; a whitened value has variance 1.
    n_iter, n_init, explained_variance, softening, random_state
        As in :class:`SphericalKMeans`.

    Attributes
    ----------
    mean_, whitening_, filters_, components_, cost_
        As in :class:`SphericalKMeans`.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> parts = rng.normal(size=(12, 8))
    >>> rows = (rng.random((1000, 12)) < 0.1) * rng.normal(size=(1000, 12)) @ parts
    >>> coder = SparseCoding(12, alpha=0.1, random_state=0).fit(rows)
    >>> codes = coder.transform(rows)
    >>> bool((codes != 0).mean() < 0.5), bool(((coder.inverse_transform(codes) - rows) ** 2).mean() < 0.05 * rows.var())
    (True, True)
    """

    def __init__(
        self,
        n_components: int = 64,
        *,
        alpha: float = 0.3,
        n_iter: int = 30,
        n_init: int = 1,
        explained_variance: float = 1.0,
        softening: float | None = None,
        random_state: Any = None,
    ) -> None:
        super().__init__(n_components, n_iter, n_init, explained_variance, softening, random_state)
        self.alpha = alpha

    def inverse_transform(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """The rows that codes stand for, shape (n_samples, n_features); without their means and contrasts where there is a softening."""
        check_is_fitted(self)
        rows: npt.NDArray[Any] = check_array(X, dtype=(np.float64, np.float32)) @ self.components_ + self.mean_
        return rows

    def _method(self) -> dict[str, Any]:
        return {"kind": "sparse", "penalty": self._real("alpha")}


class ISA(_Filters):
    """Independent subspace analysis, or ICA of two layers (Hyvarinen & Hoyer 2000), of whitened rows.

    The filters w_j are orthonormal, ``subspace_size`` to a subspace. The mean of the sum of lengths sqrt(sum (w_j . x)^2), a length for each
    subspace, is made small: few have energy at a time. ``transform`` gives the lengths, shape (n_samples, n_components), ``sources`` the
    products w_j . x. With subspaces of one filter this is ICA. It passes scikit-learn's ``check_estimator``.

    Parameters
    ----------
    n_components : int
        Subspaces at most: there are no more filters than whitened values; rows have at most 1024 values.
    subspace_size : {1, 2, 4, 8}
        Filters of a subspace.
    n_iter, n_init, explained_variance, softening, random_state
        As in :class:`SphericalKMeans`.

    Attributes
    ----------
    mean_, whitening_, filters_, components_, cost_
        As in :class:`SphericalKMeans`; filters_ has n_components * subspace_size rows or fewer, those of a subspace one after the other.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> sources = rng.laplace(size=(5000, 3))
    >>> mixed = sources @ rng.normal(size=(3, 3))
    >>> ica = ISA(3, subspace_size=1, random_state=0).fit(mixed)
    >>> match = abs(np.corrcoef(sources.T, ica.sources(mixed).T)[:3, 3:])
    >>> bool((match.max(axis=1) > 0.99).all())          # each source is one of those, up to its sign
    True
    """

    def __init__(
        self,
        n_components: int = 32,
        *,
        subspace_size: int = 2,
        n_iter: int = 100,
        n_init: int = 1,
        explained_variance: float = 1.0,
        softening: float | None = None,
        random_state: Any = None,
    ) -> None:
        super().__init__(n_components, n_iter, n_init, explained_variance, softening, random_state)
        self.subspace_size = subspace_size

    def sources(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """What each filter says of each row of X, the first layer: shape (n_samples, n_filters), of X's type of floats."""
        codes, kind = self._codes(X)
        return codes.astype(kind, copy=False)

    def _least(self) -> dict[str, int]:
        least = super()._least()
        return {**least, "ensure_min_features": max(least["ensure_min_features"], self._size())}

    def _method(self) -> dict[str, Any]:
        return {"kind": "ica", "size": self._size()}

    def _size(self) -> int:
        return self._count("subspace_size")

    def _features(self, codes: Singles) -> Singles:
        lengths: Singles = np.sqrt((codes.reshape(len(codes), -1, self._size()) ** 2).sum(axis=2))
        return lengths
