"""Parts on their own: a bandit, Bayesian optimisation, and a particle filter with a model of one's own."""

import math

import numpy as np
import numpy.typing as npt

from foveate.bandits import Exp3, GpUcb
from foveate.filter import ParticleFilter
from foveate.metrics import ope

Floats = npt.NDArray[np.float64]

# A bandit: the third arm pays most often.
rng = np.random.default_rng(1)
bandit = Exp3(3, frames=2000)
for _ in range(2000):
    arm = bandit.ask()
    bandit.tell(arm, float(rng.uniform() < (0.2, 0.5, 0.8)[arm]))
print("arms are chosen with", bandit.probabilities.round(2))
assert bandit.probabilities.argmax() == 2

# The top of a smooth function, from 40 evaluations.
search = GpUcb([(-1.0, 1.0), (-1.0, 1.0)])
for _ in range(40):
    u, v = search.ask()
    search.tell((u, v), math.exp(-((u - 0.4) ** 2 + (v + 0.1) ** 2)))
print("the best point is", search.best)
assert search.best is not None and abs(search.best[0] - 0.4) < 0.01


# A pendulum's angle from the sine of it.
def transition(x: Floats, rng: np.random.Generator) -> Floats:
    angle, speed = x.T
    moved: Floats = np.column_stack([angle + 0.05 * speed, speed - 0.05 * 9.81 * np.sin(angle)])
    moved += rng.normal(0, 0.02, x.shape)
    return moved


def log_likelihood(x: Floats, y: float) -> Floats:
    squares: Floats = -0.5 * ((y - np.sin(x[:, 0])) / 0.1) ** 2
    return squares


pendulum = ParticleFilter(lambda n, rng: rng.normal((0.9, 0.0), 0.3, (n, 2)), transition, log_likelihood, particles=2000)
truth = np.array([[1.0, 0.0]])
found, true = [], []
for _ in range(100):
    truth = transition(truth, rng)
    seen = pendulum.update(math.sin(truth[0, 0]) + rng.normal(0, 0.1))
    found.append([100 + 50 * math.sin(seen.mean[0]), 50, 20, 20])
    true.append([100 + 50 * math.sin(truth[0, 0]), 50, 20, 20])
score = ope(found, true)
print(f"the bob as a box of 20 px: AUC {score.auc:.2f}, centre error {score.centre_error:.1f} px")
assert score.centre_error < 5
