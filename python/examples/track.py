"""Follow a moving square, and print its box and P(lost)."""

import numpy as np
import numpy.typing as npt

import foveate


def picture(t: int) -> npt.NDArray[np.uint8]:
    """A textured square that moves by 3 pixels a frame."""
    image = np.random.default_rng(1).integers(0, 60, (120, 160, 3)).astype(np.uint8)
    image[40:64, 30 + 3 * t : 54 + 3 * t] = np.random.default_rng(2).integers(100, 256, (24, 24, 3))
    return image


tracker = foveate.Tracker("fast")
tracker.init(picture(0), (30, 40, 24, 24))
for t in range(1, 20):
    seen = tracker.update(picture(t))
    ok, box = seen
    region = seen.region(0.9)
    print(f"{seen.status} at {box.rounded()}, P(lost) {seen.p_lost:.2f}, within {region.major:.1f} px with 90 %")
    assert ok and abs(box.x - 30 - 3 * t) < 3
