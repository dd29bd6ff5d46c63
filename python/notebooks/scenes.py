"""The drawn videos of the notebooks, and what shows them: NumPy, and foveate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import numpy.typing as npt

import foveate
from foveate._show import _png

Picture = npt.NDArray[np.uint8]
Scene = Callable[[int], Picture]
Rectangle = tuple[float, float, float, float]

SIDE, LENGTH = 56, 120
"""Side of the target of the gaze scenes, pixels, and how many pictures they have."""


def coarse(seed: int, low: int, high: int, height: int, width: int) -> Picture:
    """Noise in squares of 4 x 4 pixels, red, green and blue apart."""
    noise = np.random.default_rng(seed).integers(low, high, (height // 4, width // 4, 3))
    return noise.repeat(4, 0).repeat(4, 1).astype(np.uint8)


# One target: a textured square on texture, which passes behind a wall from picture 40 to 60.


def passing(t: int) -> Picture:
    image = coarse(1, 0, 60, 120, 240)
    x = 20 + 2 * t
    image[48:72, x : x + 24] = coarse(2, 100, 256, 24, 24)
    image[:, 104:140] = coarse(3, 40, 90, 120, 36)
    return image


# Where to look: a target that moves on a curve through noise.


def centre(t: int) -> tuple[float, float]:
    return 80 + 35 * np.sin(t / 15), 80 + 25 * np.sin(t / 23)


def box(t: int) -> Rectangle:
    x, y = centre(t)
    return x - SIDE / 2, y - SIDE / 2, SIDE, SIDE


def ring(t: int) -> Picture:
    """A ring: its middle is empty, most of its rim is not."""
    y, x = np.mgrid[:160, :160]
    cx, cy = centre(t)
    return np.where(np.abs(np.hypot((x - cx) / 0.75, y - cy) - 20) < 4, 230, 0).astype(np.uint8)


def texture(t: int) -> Picture:
    """A square full of texture: every part of it looks different."""
    return placed(t, np.random.default_rng(3).integers(0, 256, (14, 14)).repeat(4, 0).repeat(4, 1))


def corner(t: int) -> Picture:
    """A square that is empty but for a corner."""
    look = np.zeros((14, 14), int)
    look[9:13, 9:13] = np.random.default_rng(3).integers(100, 256, (4, 4))
    return placed(t, look.repeat(4, 0).repeat(4, 1))


def placed(t: int, look: npt.NDArray[np.int64]) -> Picture:
    image = np.zeros((160, 160), np.uint8)
    x, y = (round(c - SIDE / 2) for c in centre(t))
    image[y : y + SIDE, x : x + SIDE] = look
    return image


def video(scene: Scene, seed: int = 1, noise: float = 0.3) -> list[Picture]:
    """The pictures; noise replaces that share of their pixels."""
    rng, pictures = np.random.default_rng(seed), []
    for t in range(LENGTH):
        image = scene(t)
        hit = rng.random(image.shape) < noise
        image[hit] = rng.choice([0, 255], hit.sum())
        pictures.append(image)
    return pictures


def follow(scene: Scene, policy: str, seed: int = 1) -> foveate.Run:
    """Follows the target through a window of a quarter of its side, which the policy moves."""
    tracker = foveate.Tracker("digits-closeup", config={"policy.kind": policy}, seed=seed, channels="grey")
    return foveate.Run.of(tracker, video(scene, seed), box(0))


def error(run: foveate.Run) -> float:
    """Mean distance of the box's centre from the target's, pixels."""
    return float(run.errors([box(t) for t in range(LENGTH - len(run), LENGTH)])[1 - LENGTH :].mean())


def looks(run: foveate.Run, cells: int = 9) -> str:
    """Where it looked, as a map of the box: `.` once, `o` a few times, `#` often."""
    gazes = np.array([r.gaze for r in run.results[1 - LENGTH :]])
    counts, _, _ = np.histogram2d(gazes[:, 1], gazes[:, 0], bins=cells, range=[[-1, 1], [-1, 1]])
    return "\n".join(" ".join(" .o#"[int(c > 0) + int(c > 1) + int(c > 4)] for c in row) for row in counts)


def compare(scene: Scene, seeds: Sequence[int]) -> dict[str, npt.NDArray[np.float64]]:
    """The errors of three policies on the same videos, a seed each; printed, and answered by policy."""
    errors = {policy: np.array([error(follow(scene, policy, seed)) for seed in seeds]) for policy in ("fixed", "random", "gp-ucb")}
    for policy, e in errors.items():
        print(f"{scene.__name__:8} {policy:7} mean {e.mean():5.1f} pixels, seeds {' '.join(f'{value:5.1f}' for value in e)}")
    return errors


# Many targets: three squares, two of which pass each other.

LOOKS = [coarse(10 + k, 100, 256, 24, 24) for k in range(3)]


def places(t: int) -> list[Rectangle]:
    return [(10 + 3 * t, 20, 24, 24), (170 - 3 * t, 26, 24, 24), (90, 80 - t // 2, 24, 24)]


def squares(t: int) -> Picture:
    image = coarse(1, 0, 60, 120, 220)
    for place, look in zip(places(t), LOOKS, strict=True):
        x, y, w, h = map(int, place)
        image[y : y + h, x : x + w] = look
    return image


def detections(length: int) -> list[npt.NDArray[np.float64]]:
    """What a poor detector finds in each picture, rows of left, top, width, height and score: it misses one square in five, shifts
    the others by a pixel or so, and sees a ghost now and then."""
    rng, out = np.random.default_rng(5), []
    for t in range(length):
        found = [(x + rng.normal(0, 1), y + rng.normal(0, 1), w, h, 0.9) for x, y, w, h in places(t) if rng.random() > 0.2]
        if rng.random() < 0.1:
            found.append((rng.uniform(0, 190), rng.uniform(0, 90), 24, 24, 0.4))
        out.append(np.array(found).reshape(-1, 5))
    return out


# A picture with boxes on it.

COLOURS = ["#1f77d4", "#e07b00", "#c2255c", "#2b8a3e"]


class Shown:
    """A picture with numbered boxes: solid where the tracker has a target, dashed for detections."""

    def __init__(self, image: Picture, targets: Iterable[tuple[int, Sequence[float]]], found: npt.NDArray[np.float64]) -> None:
        height, width = image.shape[:2]
        marks = [self._mark(row[:4], "#fff", 'stroke-dasharray="3"', "") for row in found.tolist()]
        for target, place in targets:
            marks.append(self._mark(place, COLOURS[(target - 1) % len(COLOURS)], "", str(target)))
        self._html = (
            f'<svg width="{2 * width}" height="{2 * height}" viewBox="0 0 {width} {height}" role="img" aria-label="targets and detections">'
            f'<image width="{width}" height="{height}" href="{_png(image)}"/>{"".join(marks)}</svg>'
        )

    @staticmethod
    def _mark(place: Sequence[float], colour: str, dash: str, name: str) -> str:
        x, y, w, h = place
        return (
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" fill="none" stroke="{colour}" stroke-width="1.5" {dash}/>'
            f'<text x="{x:.1f}" y="{y - 2:.1f}" fill="{colour}" font-size="9" font-weight="bold">{name}</text>'
        )

    def __repr__(self) -> str:
        return "<a picture with boxes>"

    def _repr_html_(self) -> str:
        return self._html
