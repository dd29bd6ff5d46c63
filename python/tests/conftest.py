"""Drawn pictures, and the sequences of FOVEATE_DATA where they are."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

ROOT = Path(__file__).resolve().parents[2]


def drawn(t: int, width: int = 160, height: int = 120) -> npt.NDArray[np.uint8]:
    """A textured square on texture, red, green and blue apart, that moves by 3 and 1 pixels a frame."""
    rng = np.random.default_rng(7)
    image = rng.integers(0, 60, (height, width, 3)).astype(np.uint8)
    square = rng.integers(100, 256, (24, 24, 3)).astype(np.uint8)
    x, y = 40 + 3 * t, 30 + t
    image[y : y + 24, x : x + 24] = square
    return image


FIRST = (40, 30, 24, 24)


@pytest.fixture(scope="session")
def pictures() -> list[npt.NDArray[np.uint8]]:
    return [drawn(t) for t in range(25)]


def sequence(name: str) -> Path:
    """A sequence of FOVEATE_DATA/tracking; skips the test where there is none."""
    data = Path(os.environ.get("FOVEATE_DATA", ROOT / "data"))
    folder = data / "tracking" / name
    if not folder.is_dir():
        pytest.skip("skipped: no data")
    return folder
