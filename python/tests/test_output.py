"""What becomes of results: pictures, tables, files of other programs."""

from __future__ import annotations

import json
import sys
import xml.etree.ElementTree as tree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIRST

import foveate


@pytest.fixture(scope="module")
def run(pictures: Any) -> foveate.Run:
    """The last pictures show nothing: their boxes are guesses."""
    return foveate.Run.of(foveate.Tracker("fast"), [*pictures[:10], *[np.zeros_like(pictures[0])] * 30], FIRST)


def test_an_answer_is_a_tuple_of_two(pictures: Any) -> None:
    tracker = foveate.Tracker("fast")
    ret: Any = tracker.init(pictures[0], FIRST)
    for picture in [None, *pictures[1:3]]:
        ret = ret if picture is None else tracker.update(picture)
        ok, box = ret
        assert isinstance(ret, tuple) and len(ret) == 2 and ret[0] is ok is ret.ok and ret[1] is ret[-1] is box is ret.box
        assert ret == (ok, box) and bool(ret) is ok
        assert box.rounded() == tuple(round(v) for v in box) and all(type(v) is int for v in box.rounded())
        with pytest.raises(IndexError):
            ret[2]


def test_the_picture_of_the_given_box(pictures: Any) -> None:
    seen = foveate.Tracker("fast").init(pictures[0], FIRST)
    assert (seen.ok, tuple(seen.box), seen.p_lost, seen.status) == (True, FIRST, 0, "tracking")
    assert seen.particles.shape == (0, 7) and seen.weights.shape == (0,) and seen.gazes.shape == (0, 2)
    # The centre of the top-left pixel is (0, 0).
    assert seen.state[:2] == (51.5, 41.5) and not seen.covariance.any() and seen.region().major == 0
    assert "svg" in seen._repr_html_()


def changed(before: Any, after: Any) -> set[tuple[int, int]]:
    return {(int(x), int(y)) for y, x in np.argwhere((before != after).any(axis=2))}


def test_drawing_marks_a_copy(pictures: Any) -> None:
    image = np.full((480, 640, 3), 90, np.uint8)
    kept = image.copy()
    seen = foveate.Tracker("fast").init(image, (100, 200, 60, 40))
    drawn = foveate.draw(image, seen)
    assert drawn.shape == image.shape and (image == kept).all() and drawn.base is not image
    # The box's edges lie between pixels: 99.5 and 159.5, 199.5 and 239.5; lines are 2 pixels wide, with a rim of 0.9.
    xs, ys = zip(*changed(image, drawn))
    assert (min(xs), max(xs), min(ys), max(ys)) == (98, 161, 198, 241)
    assert tuple(drawn[220, 99]) == tuple(drawn[220, 100]) == (57, 182, 255) and (130, 220) not in changed(image, drawn)
    # The trail ends in the centre of the box, a label is above it.
    trailed = foveate.draw(image, seen, trail=[(20, 200, 60, 40), (60, 200, 60, 40)])
    assert tuple(trailed[219, 90]) != (90, 90, 90) and {(60, 219), (120, 219)} <= changed(image, trailed)
    assert any(y < 195 for _, y in changed(image, foveate.draw(image, seen, id=7)))


def test_drawing_knows_the_order_of_colours(pictures: Any) -> None:
    draws = []
    for channels, order in (("rgb", 1), ("bgr", -1)):
        tracker = foveate.Tracker("fast", channels=channels)  # type: ignore[arg-type]
        tracker.init(pictures[0][..., ::order], FIRST)
        seen = tracker.update(pictures[1][..., ::order])
        draws.append(foveate.draw(pictures[1][..., ::order], seen)[..., ::order])
        with_particles = changed(draws[-1], foveate.draw(pictures[1][..., ::order], seen, particles=False)[..., ::order])
        assert with_particles
    np.testing.assert_array_equal(*draws)
    grey = foveate.draw(pictures[1][..., 0], seen)
    assert grey.shape == pictures[1].shape


def test_targets_are_drawn_with_their_ids(pictures: Any) -> None:
    tracker = foveate.MultiTracker(config={"particles": 60})
    seen = [tracker.update(p, [(40 + 3 * t, 30 + t, 24, 24, 0.9)]) for t, p in enumerate(pictures[:8])]
    one, more = (foveate.draw(pictures[7], seen[-1], trail=trail) for trail in ((), seen[:-1]))
    assert len(seen[-1]) == 1 and changed(pictures[7], one) and changed(one, more)


def test_a_run_becomes_a_table(run: foveate.Run) -> None:
    pytest.importorskip("pandas", reason="skipped: no pandas")
    table = run.to_dataframe()
    assert len(table) == len(run) and list(table["frame"]) == list(range(40)) and table["time"].isna().all()
    np.testing.assert_array_equal(table[["left", "top", "width", "height"]], run.boxes)
    np.testing.assert_array_equal(table["p_lost"], run.p_lost)
    assert list(table["ok"]) == [seen.ok for seen in run] and list(table["x"]) == [seen.state.x for seen in run]
    np.testing.assert_allclose(table["sd_x"] ** 2, [seen.covariance[0, 0] for seen in run])


def test_without_pandas_it_says_what_is_missing(run: foveate.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        run.to_dataframe()


def test_a_run_is_exported(run: foveate.Run, tmp_path: Path) -> None:
    sure = [at for at, seen in enumerate(run) if seen.ok]
    assert 8 < len(sure) < 40
    run.export(tmp_path / "a.json", "coco")
    coco = json.loads((tmp_path / "a.json").read_text())
    assert len(coco["images"]) == 40 and [a["image_id"] - 1 for a in coco["annotations"]] == sure
    np.testing.assert_array_equal([a["bbox"] for a in coco["annotations"]], run.boxes[sure])
    np.testing.assert_allclose([a["score"] for a in coco["annotations"]], 1 - run.p_lost[sure])
    run.export(tmp_path / "a.txt", "mot")
    mot = np.loadtxt(tmp_path / "a.txt", delimiter=",")
    assert list(mot[:, 0] - 1) == sure and set(mot[:, 1]) == {1}
    np.testing.assert_allclose(mot[:, 2:6] - [1, 1, 0, 0], run.boxes[sure], atol=1e-3)
    run.export(tmp_path / "a.xml", "cvat")
    shapes = tree.parse(tmp_path / "a.xml").getroot().findall("track/box")
    assert [int(s.attrib["frame"]) for s in shapes if s.attrib["outside"] == "0"] == sure
    run.export(str(tmp_path / "labels"), "yolo")
    labels = sorted((tmp_path / "labels").iterdir())
    assert [p.name for p in labels] == [f"{t + 1:06}.txt" for t in range(40)]
    assert [at for at, p in enumerate(labels) if p.read_text()] == sure
    kind, x, y, w, h = (float(v) for v in labels[0].read_text().split())
    np.testing.assert_allclose([kind, x * 160, y * 120, w * 160, h * 120], [0, 52, 42, 24, 24], atol=1e-3)
    run.export(tmp_path / "all.json", "coco", guesses=True)
    assert len(json.loads((tmp_path / "all.json").read_text())["annotations"]) == 40


def test_yolo_boxes_are_inside_of_the_picture(tmp_path: Path, pictures: Any, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "foveate")
    seen = foveate.Tracker("fast").init(pictures[0], (-10, 100, 30, 40))
    foveate.export([seen], tmp_path / "labels", "yolo", size=(160, 120))
    numbers = [float(v) for v in (tmp_path / "labels" / "000001.txt").read_text().split()]
    np.testing.assert_allclose(numbers, [0, 10 / 160, 110 / 120, 20 / 160, 20 / 120], atol=1e-6)
    assert any("cut at the picture's borders" in record.getMessage() for record in caplog.records)
    caplog.clear()
    inside = foveate.Tracker("fast").init(pictures[0], (50.1, 30.3, 40.7, 41.9))
    foveate.export([inside], tmp_path / "whole", "yolo", size=(160, 120))
    assert not any("cut" in record.getMessage() for record in caplog.records)


def test_targets_are_exported(tmp_path: Path, pictures: Any) -> None:
    tracker = foveate.MultiTracker(config={"particles": 60})
    found = [[(40 + 3 * t, 30 + t, 24, 24, 0.9), (100, 80 - t, 20, 20, 0.8)] for t in range(8)]
    seen = [tracker.update(p, boxes) for p, boxes in zip(pictures, found)]
    foveate.export(seen, tmp_path / "tracks.txt", "mot")
    mot = np.loadtxt(tmp_path / "tracks.txt", delimiter=",")
    wanted = [(t + 1, k, *(box + [1, 1, 0, 0])) for t, targets in enumerate(seen) for k, box in zip(targets.ids, targets.boxes)]
    np.testing.assert_allclose(mot[:, :6], wanted, atol=1e-3)
    with pytest.raises(foveate.InputError, match="targets"):
        foveate.export(seen, tmp_path / "one.txt", "otb")


def test_what_cannot_be_exported_says_so(run: foveate.Run, tmp_path: Path) -> None:
    with pytest.raises(foveate.InputError, match='coco, cvat.*yolo; it is "json"'):
        run.export(tmp_path / "a", "json")  # type: ignore[arg-type]
    with pytest.raises(foveate.InputError, match="give its size"):
        foveate.export(run, tmp_path / "a", "yolo")
    with pytest.raises(foveate.FileError, match="none"):
        run.export(tmp_path / "none" / "a.json", "coco")
