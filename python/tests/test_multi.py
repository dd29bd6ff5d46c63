"""Many targets."""

from __future__ import annotations

import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import FIRST

import foveate


def detections(t: int) -> list[list[float]]:
    return [[40 + 3 * t, 30 + t, 24, 24, 0.9]]


def test_detections_start_and_hold_a_track(pictures: Any) -> None:
    tracker = foveate.MultiTracker()
    assert len(tracker.update(pictures[0])) == 0 and len(tracker.targets) == 0
    for t in range(1, 20):
        targets = tracker.update(pictures[t], detections(t))
    assert targets.ids.tolist() == [1] and targets.boxes.shape == (1, 4) and targets.ok.tolist() == [True]
    assert abs(targets.boxes[0, 0] - 97) < 3 and targets.phases == ["tracked"]
    assert targets.states.shape == (1, 7) and targets.covariances.shape == (1, 7, 7) and targets.gazes.shape == (1, 2)
    np.testing.assert_allclose(targets.xyxy[0, 2:], targets.boxes[0, :2] + targets.boxes[0, 2:])
    assert [(i, type(b)) for i, b in targets] == [(1, foveate.Box)]
    assert "targets=1" in repr(tracker)
    tracker.cut()
    assert len(tracker.targets) == 0


def test_every_form_of_detections_is_the_same(pictures: Any) -> None:
    def boxes(form: Any) -> Any:
        tracker = foveate.MultiTracker(config={"particles": 100})
        return [tracker.update(pictures[t], form(t)).boxes.tolist() for t in range(8)]

    def corners(t: int) -> Any:
        x, y, w, h, score = detections(t)[0]
        return SimpleNamespace(xyxy=np.array([[x, y, x + w, y + h]], np.float32), confidence=np.array([score]))

    wanted = boxes(detections)
    assert wanted[-1] and boxes(corners) == wanted and boxes(lambda t: np.array(detections(t))) == wanted
    with pytest.raises(foveate.InputError, match="confidence"):
        boxes(lambda t: SimpleNamespace(xyxy=np.zeros((2, 4)), confidence=np.zeros(3)))
    assert boxes(lambda t: SimpleNamespace(xyxy=corners(t).xyxy, conf=corners(t).confidence)) == wanted, "ultralytics"
    for shape in ((2, 6), (4,)):
        with pytest.raises(foveate.InputError, match=r"\(n, 4\): left, top, right"):
            boxes(lambda t, shape=shape: SimpleNamespace(xyxy=np.ones(shape), confidence=None))
    with pytest.raises(foveate.InputError, match=r"\(1, 6\)"):
        boxes(lambda t: [[1, 2, 3, 4, 5, 6]])


def test_given_boxes_and_ids(pictures: Any) -> None:
    tracker = foveate.MultiTracker("multi-boxes", config={"particles": 100})
    assert tracker.add(pictures[0], FIRST) == 1
    assert tracker.add(pictures[0], (80, 70, 20, 20), id=7) == 7
    assert tracker.update(pictures[1]).ids.tolist() == [1, 7]
    with pytest.raises(foveate.InputError, match="2 x 2"):
        tracker.add(pictures[1], (0, 0, 1, 1))
    with pytest.raises(foveate.InputError, match="size"):
        tracker.update(pictures[1][:50])


def test_a_pickle_goes_on_bit_for_bit(pictures: Any) -> None:
    tracker = foveate.MultiTracker(config={"particles": 100}, seed=5)
    for t in range(8):
        tracker.update(pictures[t], detections(t))
    other, third = pickle.loads(pickle.dumps(tracker)), foveate.MultiTracker(config={"particles": 100}, seed=5)
    third.load(tracker.save())
    third.skip(pictures[7])
    for t in range(8, 14):
        boxes = [each.update(pictures[t], detections(t)).boxes.tolist() for each in (tracker, other, third)]
        assert boxes[0] and boxes[0] == boxes[1] == boxes[2]
    with pytest.raises(foveate.InputError, match="saved"):
        third.load(b"{}")
    # After a cut the picture before it counts no more.
    tracker.cut()
    other = pickle.loads(pickle.dumps(tracker))
    other.update(pictures[14][:50])


def test_supervision(pictures: Any) -> None:
    supervision = pytest.importorskip("supervision", reason="skipped: no supervision")
    tracker = foveate.MultiTracker(config={"particles": 100})
    for t in range(8):
        x, y, w, h, score = detections(t)[0]
        found = supervision.Detections(xyxy=np.array([[x, y, x + w, y + h]]), confidence=np.array([score]))
        targets = tracker.update(pictures[t], found)
    shown = targets.to_supervision()
    assert shown.tracker_id.tolist() == [1] and shown.data["phase"].tolist() == targets.phases
    np.testing.assert_allclose(shown.xyxy, targets.xyxy)
    assert shown.data["detection_index"].tolist() == [0] and shown.class_id is None
    assert len(foveate.MultiTracker().update(pictures[0], supervision.Detections.empty()).to_supervision()) == 0


def test_ids_stay_numbers(pictures: Any) -> None:
    tracker = foveate.MultiTracker(config={"particles": 60})
    assert tracker.add(pictures[0], (100, 80, 20, 20), id=2**63 - 1) == 2**63 - 1
    with pytest.raises(foveate.InputError, match="id is below"):
        tracker.add(pictures[0], FIRST)
    for t in range(1, 6):
        tracker.update(pictures[t], detections(t))
    assert tracker.targets.ids.tolist() == [2**63 - 1], "there is no number for another one"


def found(t: int, **more: Any) -> SimpleNamespace:
    """Two detections with corners, the second one first in odd pictures."""
    boxes = [[40 + 3 * t, 30 + t, 64 + 3 * t, 54 + t], [100, 80, 120, 100]]
    values = {"confidence": [0.9, 0.8], "class_id": [4, 6], "data": {"class_name": ["cat", "dog"], "speed": [7.5, 0.0]}} | more
    order = [1, 0] if t % 2 else [0, 1]

    def sort(x: Any) -> Any:
        return {k: sort(v) for k, v in x.items()} if isinstance(x, dict) else None if x is None else np.array(x)[order]

    return SimpleNamespace(xyxy=np.array(boxes, float)[order], **{name: sort(value) for name, value in values.items()})


def test_classes_names_and_data_are_carried_through(pictures: Any) -> None:
    tracker = foveate.MultiTracker(config={"particles": 100})
    for t in range(9):
        targets = tracker.update(pictures[t], found(t))
    by_class = {int(c): i for c, i in zip(targets.class_ids, targets.ids)}
    cat, dog = targets[by_class[4]], targets[by_class[6]]
    assert (cat.name, cat.detection_index, dog.name, dog.detection_index) == ("cat", 0, "dog", 1)
    assert cat.box.x < dog.box.x and cat.id in targets and 99 not in targets
    assert [targets.data["speed"][targets.ids.tolist().index(one.id)] for one in (cat, dog)] == [7.5, 0.0]
    with pytest.raises(KeyError, match="99"):
        targets[99]
    # Without a detection the class and its name stay.
    targets = tracker.update(pictures[9])
    assert targets[cat.id].name == "cat" and targets[cat.id].detection_index == -1 and np.isnan(targets[cat.id].score)
    assert pickle.loads(pickle.dumps(tracker)).targets.names == targets.names
    tracker.load(tracker.save())
    assert tracker.targets.names == [None, None], "a saved state has no names"
    plain = foveate.MultiTracker(config={"particles": 100})
    for t in range(5):
        targets = plain.update(pictures[t], detections(t))
    assert targets.class_ids.tolist() == [-1] and targets.names == [None] and targets.detection_index.tolist() == [0]


def test_boxes_that_are_none_are_named(pictures: Any) -> None:
    tracker = foveate.MultiTracker(config={"particles": 60})
    for bad, said in (
        ([1, 2, -3, 4, 0.5], r"detection 1 is -3 wide and 4 high"),
        ([1, 2, 3, 0, 0.5], r"detection 1 is 3 wide and 0 high"),
        ([1, 2, float("nan"), 4, 0.5], "detection 1 is not finite"),
    ):
        with pytest.raises(foveate.InputError, match=said):
            tracker.update(pictures[0], [[5, 5, 20, 20, 0.9], bad])
    with pytest.raises(foveate.InputError, match="detection 0 is -10 wide"):
        tracker.update(pictures[0], SimpleNamespace(xyxy=np.array([[30.0, 5, 20, 25]]), confidence=None))


def test_guesses_are_left_out_unless_asked_for(pictures: Any) -> None:
    tracker = foveate.MultiTracker(config={"particles": 100})
    for t in range(6):
        tracker.update(pictures[t], detections(t))
    blank = np.zeros_like(pictures[0])
    for _ in range(8):
        targets = tracker.update(blank)
    assert len(targets) == 0 and tracker.targets.phases == ["lost"]
    assert tracker.update(blank, lost=True).phases == ["lost"]


def test_a_removed_target_is_gone(pictures: Any) -> None:
    tracker = foveate.MultiTracker("multi-boxes", config={"particles": 60})
    tracker.add(pictures[0], FIRST)
    tracker.add(pictures[0], (80, 70, 20, 20), id=7)
    tracker.remove(7)
    assert tracker.targets.ids.tolist() == [1] and tracker.update(pictures[1]).ids.tolist() == [1]
    with pytest.raises(KeyError, match="7"):
        tracker.remove(7)
