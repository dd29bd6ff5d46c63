"""What all learners have: parameters that are checked, rows that are checked, and the way to the extension and back."""

from __future__ import annotations

import json
import math
import numbers
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassNamePrefixFeaturesOutMixin, TransformerMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from .._foveate import learn_codes, learn_fit, learn_scores
from ..errors import ConfigError, InputError

Singles = npt.NDArray[np.float32]
Self = TypeVar("Self", bound="FeatureLearner")


class Learner(BaseEstimator):  # type: ignore[misc]
    """Parameters and rows."""

    def _count(self, name: str) -> int:
        """A parameter that is a whole number, at least 0."""
        value = getattr(self, name)
        if isinstance(value, numbers.Integral) and not isinstance(value, bool) and int(value) >= 0:
            return int(value)
        raise ConfigError(f"{type(self).__name__}: {name} is a whole number, at least 0; got {value!r}")

    def _real(self, name: str) -> float:
        """A parameter that is a finite number."""
        value = getattr(self, name)
        if isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(value):
            return float(value)
        raise ConfigError(f"{type(self).__name__}: {name} is a finite number; got {value!r}")

    def _rows(self, X: npt.ArrayLike, **check: Any) -> tuple[Singles, np.dtype[Any]]:
        """Rows as float32, and the type of floats that they had."""
        rows = validate_data(self, X, dtype=(np.float64, np.float32), **check)
        return self._singles(rows), rows.dtype

    def _singles(self, rows: npt.NDArray[Any]) -> Singles:
        with np.errstate(over="ignore"):
            singles = np.ascontiguousarray(rows, dtype=np.float32)
        if not np.isfinite(singles).all():
            raise InputError(f"{type(self).__name__} computes in float32: X has numbers beyond 3.4e38; scale it")
        return singles


class FeatureLearner(ClassNamePrefixFeaturesOutMixin, TransformerMixin, Learner):  # type: ignore[misc]
    """Learns from rows; gives features of rows."""

    _KIND: ClassVar[str]
    """As the extension calls it."""
    _ATTRIBUTES: ClassVar[dict[str, str]]
    """Where the tensors of model files lie. Matrices are transposed here: a row is a unit."""

    random_state: Any

    def _recipe(self) -> dict[str, Any]:
        """How to learn, as the extension calls it; without the seed."""
        raise NotImplementedError

    def _recipe_for(self, rows: int) -> dict[str, Any]:
        """How to learn from so many rows."""
        del rows
        return self._recipe()

    def _least(self) -> dict[str, int]:
        """The fewest rows and values to learn from, as scikit-learn calls them."""
        return {"ensure_min_samples": 1}

    def fit(self: Self, X: npt.ArrayLike, y: object = None) -> Self:
        """Learns from the rows of X, shape (n_samples, n_features)."""
        del y
        rows, _ = self._rows(X, **self._least())
        recipe = self._recipe_for(len(rows))
        if "batch" in recipe:
            recipe["batch"] = min(recipe["batch"], len(rows))
        tensors = self._learned(rows, recipe, check_random_state(self.random_state))
        for name, at in self._ATTRIBUTES.items():
            setattr(self, at, np.ascontiguousarray(tensors[name].T))
        return self

    def _learned(self, rows: Singles, recipe: dict[str, Any], random: np.random.RandomState) -> dict[str, Singles]:
        return learn_fit(self._KIND, json.dumps({**recipe, "seed": int(random.randint(2**31 - 1))}), rows)

    def transform(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """Features of each row of X: shape (n_samples, n_features_out), of X's type of floats."""
        codes, kind = self._codes(X)
        features: npt.NDArray[Any] = self._features(codes).astype(kind, copy=False)
        return features

    def _codes(self, X: npt.ArrayLike) -> tuple[Singles, np.dtype[Any]]:
        rows, kind = self._seen(X)
        return learn_codes(*self._model(), rows), kind

    def _features(self, codes: Singles) -> Singles:
        """Converts the extension's codes."""
        return codes

    @property
    def _n_features_out(self) -> int:
        """How many features a row has."""
        raise NotImplementedError

    def _seen(self, X: npt.ArrayLike) -> tuple[Singles, np.dtype[Any]]:
        check_is_fitted(self)
        return self._rows(X, reset=False)

    def _model(self) -> tuple[str, str, dict[str, Singles]]:
        tensors = {name: np.ascontiguousarray(getattr(self, at).T) for name, at in self._ATTRIBUTES.items()}
        return self._KIND, json.dumps({**self._recipe(), "seed": 0}), tensors

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.transformer_tags.preserves_dtype = ["float64", "float32"]
        return tags


class Density(FeatureLearner):
    """A learner that also scores how likely rows are."""

    def score_samples(self, X: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """log p(v) of each row, nats, up to a constant that is the same for all: minus the free energy; shape (n_samples,)."""
        rows, _ = self._seen(X)
        return learn_scores(*self._model(), rows)
