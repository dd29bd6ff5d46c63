"""Parts on their own, against oracles."""

from __future__ import annotations

import itertools
import math
import pickle
from typing import Any

import numpy as np
import pytest

import foveate
from foveate import bandits, filter, metrics


def test_hedge_keeps_its_bound() -> None:
    k, steps = 5, 1000
    hedge, rng = bandits.Hedge(k, frames=steps), np.random.default_rng(3)
    gain, earned = np.zeros(k), 0.0
    for t in range(steps):
        rewards = rng.uniform(0, 1, k) * (np.arange(k) == (1 if t < 500 else 2))
        earned += float(hedge.probabilities @ rewards)
        hedge.ask()
        hedge.tell(rewards)
        gain += rewards
    assert gain.max() - earned <= math.sqrt(steps * math.log(k) / 2)


def test_hedge_is_the_closed_form() -> None:
    hedge, gain = bandits.Hedge(3, gamma=0.7), np.zeros(3)
    for rewards in ([0.1, 0.9, 0.3], [1, 0, 0.5], [0, 0, 1]):
        hedge.ask()
        hedge.tell(rewards)
        gain += rewards
    wanted = np.exp(0.7 * gain)
    np.testing.assert_allclose(hedge.probabilities, wanted / wanted.sum())


@pytest.mark.parametrize("implicit", [False, True])
def test_exp3_finds_the_best_arm(implicit: bool) -> None:
    bandit, rng = bandits.Exp3(4, frames=3000, implicit=implicit), np.random.default_rng(5)
    worth = [0.3, 0.4, 0.8, 0.1]
    chosen = [0] * 4
    for _ in range(3000):
        arm = bandit.ask()
        chosen[arm] += 1
        bandit.tell(arm, float(rng.uniform() < worth[arm]))
    assert chosen[2] > 1800, chosen


def test_bandits_say_what_is_wrong_and_can_be_pickled() -> None:
    exp3 = bandits.Exp3(3)
    with pytest.raises(foveate.InputError, match="call ask once before each tell"):
        exp3.tell(0, 0.5)
    arm = exp3.ask()
    with pytest.raises(foveate.InputError, match=f"arm that ask returned, {arm}"):
        exp3.tell((arm + 1) % 3, 0.5)
    for wrong in (-0.1, 1.1, float("nan")):
        with pytest.raises(foveate.InputError, match="0 to 1"):
            exp3.tell(arm, wrong)
    hedge = bandits.Hedge(3)
    hedge.ask()
    with pytest.raises(foveate.InputError, match="expected 3 rewards"):
        hedge.tell([0.1, 0.2])
    for make in (lambda: bandits.Hedge(0), lambda: bandits.Exp3(3, gamma=2.0), lambda: bandits.GpUcb(reach=-1.0)):
        with pytest.raises(foveate.ConfigError):
            make()
    assert bandits.Hedge(3, gamma=np.float32(0.5)).ask() == bandits.Hedge(3, gamma=0.5).ask()  # type: ignore[arg-type]
    assert 0 <= bandits.Exp3(3, frames=np.int64(10)).ask() < 3  # type: ignore[arg-type]
    for rate in (math.nan, math.inf, {1, 2}):
        with pytest.raises(foveate.ConfigError, match="finite numbers"):
            bandits.Hedge(3, gamma=rate)  # type: ignore[arg-type]
    with pytest.raises(foveate.ConfigError, match="windows"):
        bandits.GpUcb(windows=3)
    with pytest.raises(foveate.InputError, match="not both"):
        bandits.Hedge(3, gamma=0.1, frames=10)
    with pytest.raises(foveate.ConfigError, match="window"):
        bandits.GpUcb(window=1)
    for bounds in ([], [(0, 1)] * 15, [(1, 0)], [(0, math.inf)]):
        with pytest.raises(foveate.ConfigError, match="variables|bounds"):
            bandits.GpUcb(bounds)
    gp = bandits.GpUcb()
    for point, reward in [((0.6, 0), 0.5), ((0, 0), math.inf), ((0, 0), 1e308), ((math.nan, 0), 1), ((0, 0, 0), 1)]:
        with pytest.raises(foveate.InputError):
            gp.tell(point, reward)
    assert gp.best is None
    for _ in range(15):
        u, v = gp.ask()
        gp.tell((u, v), u - v)
    other = pickle.loads(pickle.dumps(gp))
    assert [gp.ask() for _ in range(1)] == [other.ask() for _ in range(1)]
    mean, deviation = gp.predict([(0.5, -0.5), (-0.5, 0.5)])
    assert mean[0] > mean[1] and (deviation >= 0).all()
    with pytest.raises(foveate.InputError, match="2 numbers"):
        gp.predict([[0.1, 0.2, 0.3]])


def branin(x: float, y: float) -> float:
    """Above its minimum."""
    valley = (y - 5.1 / (4 * math.pi**2) * x * x + 5 / math.pi * x - 6) ** 2
    return valley + 10 * (1 - 0.125 / math.pi) * math.cos(x) + 10 - 0.39788735772973816


def regret(function: Any, bounds: Any, evaluations: int, seed: int) -> float:
    """The least value found."""
    search, least = bandits.GpUcb(bounds, seed=seed), math.inf
    for _ in range(evaluations):
        point = search.ask()
        value = function(*point)
        search.tell(point, -value)
        least = min(least, value)
    assert search.best is not None and function(*search.best) <= 10 * least + 1e-6
    return least


def test_bayesian_optimisation_finds_the_minimum_of_branin() -> None:
    """60 evaluations, the median of 5 seeds: scikit-optimize's is 3e-4."""
    found = sorted(regret(branin, [(-5, 10), (0, 15)], 60, seed) for seed in range(5))
    assert found[2] < 3e-4, found


def test_bayesian_optimisation_knows_any_number_of_dimensions() -> None:
    """A sphere whose minimum is off the middle, in one dimension and in ten: the median of 3 seeds. In ten its mean is 11."""
    for dimensions, evaluations, least in ((1, 15, 1e-3), (10, 60, 0.1)):
        sphere = lambda *x: sum((x - 0.3) ** 2 for x in x)  # noqa: E731
        found = sorted(regret(sphere, [(-1, 2)] * dimensions, evaluations, seed) for seed in range(3))
        assert found[1] < least, (dimensions, found)


def kalman(observations: Any, q: float, r: float) -> tuple[float, float, float]:
    """Mean, variance and log evidence of a random walk from N(0, 1) seen through noise."""
    mean, variance, evidence = 0.0, 1.0, 0.0
    for y in observations:
        variance += q
        s = variance + r
        evidence += -0.5 * (math.log(2 * math.pi * s) + (y - mean) ** 2 / s)
        gain = variance / s
        mean, variance = mean + gain * (y - mean), (1 - gain) * variance
    return mean, variance, evidence


@pytest.mark.parametrize("scheme", ["systematic", "stratified", "residual", "multinomial"])
def test_the_particle_filter_is_kalmans_on_a_linear_gaussian_model(scheme: Any) -> None:
    """20,000 particles, one seed: mean within 0.03, variance within 5 %, log evidence within 0.1 (some 4 standard errors)."""
    q, r = 0.2, 0.5
    rng = np.random.default_rng(11)
    observations = np.cumsum(rng.normal(0, math.sqrt(q), 30)) + rng.normal(0, math.sqrt(r), 30)
    pf = filter.ParticleFilter(
        start=lambda n, rng: rng.normal(0, 1, (n, 1)),
        transition=lambda x, rng: x + rng.normal(0, math.sqrt(q), x.shape),
        log_likelihood=lambda x, y: -0.5 * (math.log(2 * math.pi * r) + (y - x[:, 0]) ** 2 / r),
        particles=20_000,
        scheme=scheme,
    )
    for y in observations:
        seen = pf.update(y)
    mean, variance, evidence = kalman(observations, q, r)
    assert abs(seen.mean[0] - mean) < 0.03
    assert abs(seen.covariance[0, 0] / variance - 1) < 0.05
    assert abs(pf.log_evidence - evidence) < 0.1
    np.testing.assert_allclose(seen.ess, 1 / (pf.weights**2).sum())


def test_the_particle_filter_is_that_of_particles() -> None:
    """Stochastic volatility, whose filter has no closed form, against Chopin's package `particles`: 20,000 particles and one seed
    each; means within 0.1, variances within 20 %, log evidence within 0.15: 4 standard errors of the difference, by 25 seeds."""
    particles = pytest.importorskip("particles", reason="skipped: no package particles")
    models, collectors = pytest.importorskip("particles.state_space_models"), pytest.importorskip("particles.collectors")
    mu, rho, sigma = -1.0, 0.9, 0.4
    rng, x, observations = np.random.default_rng(5), mu, []
    for _ in range(50):
        x = mu + rho * (x - mu) + rng.normal(0, sigma)
        observations.append(rng.normal(0, math.exp(x / 2)))
    np.random.seed(3)
    model = models.Bootstrap(ssm=models.StochVol(mu=mu, rho=rho, sigma=sigma), data=observations)
    theirs = particles.SMC(fk=model, N=20_000, collect=[collectors.Moments()])
    theirs.run()
    pf = filter.ParticleFilter(
        start=lambda n, rng: rng.normal(mu, sigma / math.sqrt(1 - rho**2), (n, 1)),
        transition=lambda x, rng: mu + rho * (x - mu) + rng.normal(0, sigma, x.shape),
        log_likelihood=lambda x, y: -0.5 * (math.log(2 * math.pi) + x[:, 0] + y**2 * np.exp(-x[:, 0])),
        particles=20_000,
    )
    seen = [pf.update(y) for y in observations]
    for ours, other in zip(seen, theirs.summaries.moments, strict=True):
        assert abs(ours.mean[0] - float(np.squeeze(other["mean"]))) < 0.1
        assert abs(ours.covariance[0, 0] / float(np.squeeze(other["var"])) - 1) < 0.2
    assert abs(pf.log_evidence - theirs.logLt) < 0.15


def test_a_particle_without_weight_has_no_say() -> None:
    """It fits best, by more than a double can hold, after it has lost all weight."""
    for ahead in (1000.0, 1e6):
        pf = filter.ParticleFilter(
            start=lambda n, rng: np.arange(float(n))[:, None],
            transition=lambda x, rng: x,
            log_likelihood=lambda x, y: np.where(x[:, 0] == 0, y, 0.0),
            particles=3,
            below=0,
        )
        pf.update(-np.inf)
        seen = pf.update(ahead)
        np.testing.assert_allclose(pf.weights, [0, 0.5, 0.5])
        assert seen.mean[0] == pytest.approx(1.5) and seen.log_evidence == pytest.approx(0)


def test_the_particle_filter_says_what_is_wrong() -> None:
    def make(**changed: Any) -> filter.ParticleFilter:
        settings: dict[str, Any] = {
            "start": lambda n, rng: np.zeros((n, 2)),
            "transition": lambda x, rng: x,
            "log_likelihood": lambda x, y: np.zeros(len(x)),
            "particles": 10,
        }
        return filter.ParticleFilter(**{**settings, **changed})

    assert make().update(None).ess == pytest.approx(10)
    nothing = make(log_likelihood=lambda x, y: np.full(len(x), -np.inf))
    assert nothing.update(None).log_evidence == -np.inf and nothing.weights.sum() == pytest.approx(1)
    for wrong in (
        lambda: make(particles=0),
        lambda: make(start=lambda n, rng: np.zeros(n)),
        lambda: make(transition=lambda x, rng: x[:3]).update(None),
        lambda: make(transition=lambda x, rng: x * np.nan).update(None),
        lambda: make(log_likelihood=lambda x, y: np.full(len(x), np.nan)).update(None),
        lambda: make(log_likelihood=lambda x, y: 0.0).update(None),
        lambda: filter.resample([0.0, 0.0]),
        lambda: filter.resample([1.0, -1.0]),
        lambda: filter.resample([1.0], count=10**12),
        lambda: filter.resample([1.0], scheme="best"),  # type: ignore[arg-type]
    ):
        with pytest.raises(foveate.InputError):
            wrong()


def test_ope_is_what_numpy_says() -> None:
    rng = np.random.default_rng(2)
    truth = np.column_stack([rng.uniform(0, 50, (40, 2)), rng.uniform(10, 30, (40, 2))])
    boxes = truth + rng.normal(0, 6, truth.shape).clip(-8, 8)
    boxes[0], truth[5], boxes[9] = truth[0], np.nan, np.nan
    score = metrics.ope(boxes, truth)
    counts = ~np.isnan(truth[:, 0])
    b, t = np.where(np.isnan(boxes[counts]), -1e9, boxes[counts]), truth[counts]
    overlap = np.minimum(b[:, :2] + b[:, 2:], t[:, :2] + t[:, 2:]) - np.maximum(b[:, :2], t[:, :2])
    inter = overlap.clip(0).prod(axis=1)
    iou = inter / (b[:, 2:].prod(axis=1) + t[:, 2:].prod(axis=1) - inter)
    success = [(iou > threshold).mean() for threshold in np.linspace(0, 1, 21)]
    np.testing.assert_allclose(score.success, success, atol=1e-12)
    np.testing.assert_allclose(score.auc, np.mean(success))
    assert score.frames == 39 and score.precision.shape == (51,) and score.centre_error == math.inf
    with pytest.raises(foveate.InputError, match="40 frames"):
        metrics.ope(boxes[1:], truth)
    with pytest.raises(foveate.InputError, match="shape"):
        metrics.ope(boxes[0], truth)


def test_mot_figures_of_a_swap() -> None:
    """Two targets whose tracks change places half-way: detection is whole, identity is half."""
    truth = [(t, k, 50 * k, 0, 20, 20) for t, k in itertools.product(range(10), range(2))]
    tracks = [(t, k if t < 5 else 1 - k, 50 * k, 0, 20, 20) for t, k in itertools.product(range(10), range(2))]
    score = metrics.mot(tracks, truth)
    assert score["idf1"] == 0.5 and score["det_a"] == 1.0 and score["switches"] == 2
    np.testing.assert_allclose(score["ass_a"], 1 / 3)
    np.testing.assert_allclose(score["hota"], math.sqrt(1 / 3))
    assert metrics.mot([], truth)["mota"] == 0.0
    for wrong in ([(0.5, 0, 1, 1, 1, 1)], [(0, -1, 1, 1, 1, 1)], [(0, 0, 1)], [(0, 0, math.nan, 1, 1, 1)]):
        with pytest.raises(foveate.InputError):
            metrics.mot(wrong, truth)


def test_mistakes_are_errors_at_once() -> None:
    with pytest.raises(foveate.InputError, match="multinomial"):
        filter.ParticleFilter(lambda n, rng: np.zeros((n, 1)), lambda x, rng: x, lambda x, y: x[:, 0], scheme="none")  # type: ignore[arg-type]
    with pytest.raises(foveate.InputError, match="one row"):
        filter.resample([[1, 2]])
    with pytest.raises(foveate.InputError, match=r"\(n, 6\) or \(n, 7\)"):
        metrics.mot([[0, 0, 1, 1, 2]], [])
