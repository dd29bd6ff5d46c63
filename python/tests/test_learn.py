"""Learners with scikit-learn's protocol: its own checks, and oracles."""

from __future__ import annotations

import _thread
import itertools
import math
import pickle
import signal
import threading
import time
import warnings
from collections.abc import Callable
from typing import Any

import foveate
import numpy as np
import pytest

pytest.importorskip("sklearn", reason="skipped: no scikit-learn")

from foveate.learn import RBM, SoftmaxRegression, SphericalKMeans
from sklearn.base import clone
from sklearn.cluster import KMeans
from sklearn.datasets import load_digits, load_iris, load_wine
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import adjusted_rand_score
from sklearn.neural_network import BernoulliRBM
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import check_estimator

SMALL: list[Any] = [
    RBM(3, n_iter=2),
    SphericalKMeans(3, n_iter=2),
    SphericalKMeans(3, n_iter=2, softening=1.0),
]
EVERY = [*SMALL, SoftmaxRegression()]


@pytest.mark.parametrize("estimator", EVERY, ids=str)
def test_they_are_good_estimators(estimator: Any) -> None:
    """What scikit-learn skips needs pandas or scipy's array API."""
    check_estimator(estimator, on_skip=None)


@pytest.mark.parametrize("estimator", EVERY, ids=str)
def test_the_same_seed_learns_the_same_and_mistakes_are_errors(estimator: Any) -> None:
    rng = np.random.default_rng(4)
    rows, labels = rng.normal(size=(60, 5)), rng.integers(0, 3, 60)
    first = clone(estimator)
    if "random_state" in first.get_params():
        first.set_params(random_state=7)
    makes = "predict_proba" if isinstance(first, SoftmaxRegression) else "transform"
    made = getattr(first.fit(rows, labels), makes)(rows)
    foveate.set_threads(1)
    try:
        again = getattr(clone(first).fit(rows, labels), makes)(rows)
    finally:
        foveate.set_threads(0)
    np.testing.assert_array_equal(again, made)
    np.testing.assert_array_equal(getattr(pickle.loads(pickle.dumps(first)), makes)(rows), made)
    for wrong, said in [
        (np.full((60, 5), np.nan), "NaN"),
        (np.zeros((0, 5)), "0 sample"),
        (rows[0], "Expected 2D array"),
        (rows * 1e300, "scale it"),
    ]:
        with pytest.raises(ValueError, match=said):
            clone(first).fit(wrong, labels[: len(wrong)])
    with pytest.raises(ValueError, match="expecting 5 features"):
        getattr(first, makes)(rows[:, :3])
    for name, value in first.get_params().items():
        if isinstance(value, int | float) and not isinstance(value, bool) and name not in ("random_state", "C", "tol"):
            for bad in (float("nan"), "many", True):
                with pytest.raises(foveate.ConfigError, match=name):
                    clone(first).set_params(**{name: bad}).fit(rows, labels).transform(rows)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (SphericalKMeans(61), "61 filters need as many"),
        (SphericalKMeans(0), "filters are 1 to"),
        (SphericalKMeans(3, explained_variance=1.5), "share of variance"),
        (SphericalKMeans(3, softening=0.0), "softening"),
        (RBM(3, visible="grey"), "visible|variant"),  # type: ignore[arg-type]
        (SoftmaxRegression(C=0.0), "C is above 0"),
        (SoftmaxRegression(max_iter=0), "max_iter"),
    ],
    ids=str,
)
def test_parameters_out_of_range_are_errors(wrong: Any, said: str) -> None:
    rng = np.random.default_rng(4)
    with pytest.raises(ValueError, match=said):
        wrong.fit(rng.normal(size=(60, 5)), rng.integers(0, 3, 60))


def test_the_interpreter_goes_on_while_they_learn() -> None:
    rows, ticks = np.random.default_rng(0).normal(size=(2000, 60)), 0
    learner = threading.Thread(target=SphericalKMeans(500, n_iter=200).fit, args=(rows,))
    learner.start()
    while learner.is_alive():
        time.sleep(0.01)
        ticks += 1
    assert ticks > 5


def test_free_energies_sum_to_the_partition_function() -> None:
    """score_samples is log p(v) up to a constant: by enumeration of all v and h."""
    rows = np.random.default_rng(0).integers(0, 2, (100, 4)).astype(np.float32)
    rbm = RBM(n_components=3, visible="bernoulli", n_iter=5, learning_rate=0.5, random_state=1).fit(rows)
    visible = np.array(list(itertools.product([0, 1], repeat=4)), np.float32)
    hidden = np.array(list(itertools.product([0, 1], repeat=3)), np.float32)
    joint = visible @ rbm.components_.T @ hidden.T
    joint += (visible @ rbm.intercept_visible_)[:, None] + hidden @ rbm.intercept_hidden_
    np.testing.assert_allclose(rbm.score_samples(visible), np.log(np.exp(joint).sum(axis=1)), rtol=1e-5)
    posterior = np.exp(joint) / np.exp(joint).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(rbm.transform(visible), posterior @ hidden, rtol=1e-4)
    again = RBM(n_components=3, visible="bernoulli", n_iter=5, learning_rate=0.5, random_state=1).fit(rows)
    np.testing.assert_array_equal(again.components_, rbm.components_)
    with pytest.raises(foveate.InputError):
        RBM(visible="bernoulli").fit(rows - 3)


def test_separated_clusters_are_those_of_scikit_learn() -> None:
    """Six directions, of any length: the same parts as KMeans of the whitened rows at length 1."""
    rng = np.random.default_rng(3)
    labels = rng.integers(0, 6, 1200)
    rows = rng.normal(size=(6, 10))[labels] * rng.uniform(3, 9, (1200, 1)) + 0.3 * rng.normal(size=(1200, 10))
    model = SphericalKMeans(6, random_state=0).fit(rows)
    found = model.transform(rows).argmax(axis=1)
    white = (rows - model.mean_) @ model.whitening_.T
    theirs = KMeans(6, n_init=10, random_state=0).fit_predict(white / np.linalg.norm(white, axis=1, keepdims=True))
    assert adjusted_rand_score(found, theirs) == adjusted_rand_score(found, labels) == 1
    np.testing.assert_allclose(np.linalg.norm(model.filters_, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(model.components_ @ model.whitening_.T, model.filters_, atol=1e-4)
    products = np.maximum(white @ model.filters_.T - 0.5, 0)
    np.testing.assert_allclose(clone(model).set_params(threshold=0.5).fit(rows).transform(rows), products, atol=1e-4)


@pytest.mark.parametrize("C", [0.1, 1.0, 10.0])
def test_softmax_regression_is_scikit_learns(C: float) -> None:
    """Three classes: weights within 2e-3, probabilities within 1e-3. Two classes: half the penalty."""
    X, y = load_iris(return_X_y=True)
    X = StandardScaler().fit_transform(X)
    ours = SoftmaxRegression(C=C, tol=1e-6).fit(X, y)
    theirs = LogisticRegression(C=C, tol=1e-8, max_iter=1000).fit(X, y)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, atol=2e-3)
    np.testing.assert_allclose(ours.predict_proba(X), theirs.predict_proba(X), atol=1e-3)
    names = np.array(["setosa", "versicolor", "virginica"])[y]
    assert ours.score(X, y) == SoftmaxRegression(C=C, tol=1e-6).fit(X, names).score(X, names) == theirs.score(X, y)
    two = y < 2
    ours = SoftmaxRegression(C=C, tol=1e-6).fit(X[two], y[two])
    theirs = LogisticRegression(C=2 * C, tol=1e-8, max_iter=1000).fit(X[two], y[two])
    np.testing.assert_allclose(ours.predict_proba(X), theirs.predict_proba(X), atol=1e-3)


@pytest.mark.parametrize(
    ("load", "C"), [*itertools.product([load_iris, load_wine], [0.01, 1.0, 100.0]), (load_digits, 0.01)]
)
def test_softmax_regression_keeps_its_promise_by_default(load: Callable[..., Any], C: float) -> None:
    """Rows as they come, in uneven units and far from 0, with the parameters of the default: weights within 2e-3 of the minimum."""
    X, y = load(return_X_y=True)
    X = X / 16 if load is load_digits else X + 100
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ours = SoftmaxRegression(C=C).fit(X, y)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = LogisticRegression(C=C, tol=1e-12, max_iter=100_000, solver="newton-cg").fit(X - X.mean(axis=0), y)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, atol=2e-3)
    np.testing.assert_allclose(ours.predict_proba(X), theirs.predict_proba(X - X.mean(axis=0)), atol=1e-4)


def test_a_sample_weight_is_a_row_so_many_times() -> None:
    """As scikit-learn's: rows of weight 0 do not count, and C refers to the sum of weights."""
    X, y = load_iris(return_X_y=True)
    weight = np.random.default_rng(0).integers(0, 4, len(y))
    ours = SoftmaxRegression().fit(X, y, sample_weight=weight)
    repeated = SoftmaxRegression().fit(np.repeat(X, weight, axis=0), np.repeat(y, weight))
    np.testing.assert_allclose(ours.coef_, repeated.coef_, atol=1e-5)
    theirs = LogisticRegression(tol=1e-10, max_iter=10_000).fit(X, y, sample_weight=weight)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, atol=2e-3)
    for wrong in (np.ones(3), -np.ones(150), np.zeros(150), np.full(150, np.nan)):
        with pytest.raises(ValueError, match="sample_weight|[Ss]ample weights|Negative|NaN"):
            SoftmaxRegression().fit(X, y, sample_weight=wrong)


def pseudo_likelihood(machine: Any, rows: Any) -> float:
    """log p of each bit given all others, summed: the mean over rows, in nats."""
    free = -machine.score_samples(rows)
    total = np.zeros(len(rows))
    for bit in range(rows.shape[1]):
        flipped = rows.copy()
        flipped[:, bit] = 1 - flipped[:, bit]
        total -= np.logaddexp(0, free + machine.score_samples(flipped))
    return float(total.mean())


@pytest.mark.parametrize("count", [300, 1797])
def test_the_defaults_of_an_rbm_suit_small_sets(count: int) -> None:
    """Digits of 8 x 8: no worse than scikit-learn's machine of as many units; before, -25 nats. Both judged by one formula."""
    rows = load_digits().data[:count].astype(np.float32) / 16
    ours = RBM(64, visible="bernoulli", random_state=0).fit(rows)
    theirs = BernoulliRBM(64, random_state=0).fit(rows)
    same = RBM(64, visible="bernoulli", random_state=0, n_iter=1).fit(rows)
    same.components_ = theirs.components_.astype(np.float32)
    same.intercept_hidden_, same.intercept_visible_ = (x.astype(np.float32) for x in (theirs.intercept_hidden_, theirs.intercept_visible_))
    own, other = pseudo_likelihood(ours, rows), pseudo_likelihood(same, rows)
    assert own > max(other, -17.0), (own, other)
    assert ours.n_iter_ * math.ceil(count / ours.batch_size_) >= 2700
    for name in ("learning_rate", "batch_size", "n_iter"):
        for bad in (float("nan"), "many", True):
            with pytest.raises(foveate.ConfigError, match=name):
                RBM(3).set_params(**{name: bad}).fit(rows)


def test_softmax_regression_says_what_is_wrong() -> None:
    X, y = load_digits(return_X_y=True)
    with pytest.warns(ConvergenceWarning, match="after 5 steps"):
        model = SoftmaxRegression(max_iter=5).fit(X, y)
    assert model.n_iter_ == 5
    for labels, said in [(np.zeros(len(y)), "has 1 class"), (np.arange(len(y)) % 300, "2 to 256 classes"), (y + 0.5, "Unknown label type")]:
        with pytest.raises(ValueError, match=said):
            SoftmaxRegression().fit(X, labels)


def pressed(work: Callable[[], object]) -> float:
    """Seconds from Ctrl-C, pressed while it works, to KeyboardInterrupt."""
    # A shell starts what it runs in the background deaf to Ctrl-C.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    when = [0.0]

    def press() -> None:
        when[0] = time.monotonic()
        _thread.interrupt_main()

    timer = threading.Timer(0.3, press)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            work()
        return time.monotonic() - when[0]
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)


LONG: list[tuple[Any, str]] = [
    (RBM(4, n_iter=2**30), "fit"),
    (RBM(2000, learning_rate=0.0), "score_samples"),
    (SphericalKMeans(2000, n_iter=2**30), "fit"),
    (SoftmaxRegression(tol=0.0, max_iter=2**30), "fit"),
]


@pytest.mark.parametrize(("estimator", "method"), LONG, ids=[f"{type(one).__name__}-{method}" for one, method in LONG])
def test_ctrl_c_ends_whatever_takes_long(estimator: Any, method: str) -> None:
    """Each takes 5 s at least, a pass or a call alone in most cases. One of three tries may meet a machine that is busy otherwise."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(20_000, 240)).astype(np.float32)
    labels = rng.integers(0, 100, len(rows))
    model = clone(estimator).set_params(**{"n_iter": 1} if method != "fit" else {})
    if method != "fit":
        model.fit(rows[:500])
    work = (lambda: model.fit(rows, labels)) if method == "fit" else (lambda: getattr(model, method)(rows))
    assert min(pressed(work) for _ in range(3)) < 1.0
