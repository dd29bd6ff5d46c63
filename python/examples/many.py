"""Follow many targets with a detector of your own: here one that reads the true places, and sometimes misses one."""

import numpy as np
import numpy.typing as npt

import foveate


def picture(t: int) -> npt.NDArray[np.uint8]:
    """Two textured squares that pass each other."""
    image = np.random.default_rng(1).integers(0, 60, (120, 200, 3)).astype(np.uint8)
    for k, (x, y, _, _) in enumerate(places(t)):
        image[y : y + 24, x : x + 24] = np.random.default_rng(k + 2).integers(100, 256, (24, 24, 3))
    return image


def places(t: int) -> list[tuple[int, int, int, int]]:
    """Their boxes."""
    return [(10 + 3 * t, 20, 24, 24), (150 - 3 * t, 70, 24, 24)]


tracker = foveate.MultiTracker(config={"particles": 100})
for t in range(30):
    found = [] if t % 7 == 6 else [(*place, 0.9) for place in places(t)]
    targets = tracker.update(picture(t), found)
    for (target, box), phase in zip(targets, targets.phases):
        print(t, target, phase, box.rounded())
assert targets.ids.tolist() == [1, 2]
assert np.abs(targets.boxes[:, 0] - [97, 63]).max() < 4
