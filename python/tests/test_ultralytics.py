"""Detections of ultralytics' models, taken as they are."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import foveate
from foveate._detections import rows


class Tensor:
    """On another device: NumPy cannot make an array of it before it is copied."""

    def __init__(self, values: Any, device: str = "cuda") -> None:
        self.values, self.device = np.asarray(values, dtype=np.float32), device

    def cpu(self) -> Tensor:
        return Tensor(self.values, "cpu")

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        if self.device != "cpu":
            raise TypeError("can't convert cuda:0 device type tensor to numpy")
        return self.values.astype(dtype)


class Boxes:
    """As ``ultralytics.engine.results.Boxes``."""

    def __init__(self, xyxy: Tensor, conf: Tensor) -> None:
        self.xyxy, self.conf = xyxy, conf

    def cpu(self) -> Boxes:
        return Boxes(self.xyxy.cpu(), self.conf.cpu())

    def __len__(self) -> int:
        return len(self.xyxy.values)


def results(*boxes: tuple[float, ...]) -> Any:
    numbers = np.array(boxes, dtype=np.float32).reshape(-1, 5)
    return SimpleNamespace(boxes=Boxes(Tensor(numbers[:, :4]), Tensor(numbers[:, 4])), obb=None, names={0: "person"})


def test_results_are_detections(pictures: Any) -> None:
    one = results((10, 20, 40, 80, 0.5), (1, 2, 3, 5, 0.25))
    wanted = [[10, 20, 30, 60, 0.5], [1, 2, 2, 3, 0.25]]
    for given in (one, [one], one.boxes, SimpleNamespace(boxes=None, obb=one.boxes)):
        assert rows(given)[:, :5].tolist() == wanted
    assert len(rows(results())) == 0
    with pytest.raises(foveate.InputError, match=r"2 pictures.*results\[0\]"):
        rows([one, one])
    targets = foveate.MultiTracker(config={"particles": 60}).update(pictures[0], [results((40, 30, 64, 54, 0.9))])
    assert len(targets) <= 1


def test_of_the_package_itself() -> None:
    engine = pytest.importorskip("ultralytics.engine.results", reason="skipped: no ultralytics")
    import torch

    numbers = torch.tensor([[10, 20, 40, 80, 0.5, 0]])
    one = engine.Results(np.zeros((90, 120, 3), np.uint8), "a.png", {0: "person"}, boxes=numbers)
    assert rows([one])[:, :5].tolist() == [[10, 20, 30, 60, 0.5]]
