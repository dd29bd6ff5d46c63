"""Programs for OpenCV's trackers, after the change of two lines that docs/from-opencv.md has."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIRST, drawn
from test_documents import environment

from foveate import InputError, cv2_compat

PROGRAM = Path(__file__).with_name("csrt_program.py")
BEFORE = ["import cv2", "tracker = cv2.TrackerCSRT_create()"]
AFTER = ["import cv2\nfrom foveate import cv2_compat", "tracker = cv2_compat.TrackerFoveate_create()"]


def test_a_csrt_program_runs_with_two_lines_changed(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="skipped: no opencv")
    text = PROGRAM.read_text()
    assert len(text.splitlines()) >= 60
    for before, after in zip(BEFORE, AFTER):
        assert text.count(before + "\n") == 1
        text = text.replace(before + "\n", after + "\n")
    (tmp_path / "program.py").write_text(text)
    film = cv2.VideoWriter(str(tmp_path / "video.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25, (160, 120))
    for t in range(25):
        film.write(drawn(t)[..., ::-1].copy())
    film.release()
    command = [sys.executable, "program.py", "video.avi", "out.avi", ",".join(str(v) for v in FIRST)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment())
    assert done.returncode == 0, done.stderr
    boxes = np.array([[int(v) for v in line.split(",")] for line in done.stdout.splitlines()])
    truth = np.array([(40 + 3 * t, 30 + t, 24, 24) for t in range(25)])
    assert boxes.shape == (25, 4) and np.abs(boxes - truth).max() <= 4
    shown = cv2.VideoCapture(str(tmp_path / "out.avi"))
    assert int(shown.get(cv2.CAP_PROP_FRAME_COUNT)) == 24


def test_boxes_are_whole_pixels_inside_of_the_picture(pictures: Any) -> None:
    tracker = cv2_compat.TrackerFoveate.create("fast", {"particles": 60})
    with pytest.raises(InputError, match="init"):
        tracker.getTrackingScore()
    # A box that lies half outside: a slice of the picture is a picture all the same.
    tracker.init(pictures[0], (-20, -10, 40, 40))
    assert tracker.getTrackingScore() == 1
    for picture in pictures[1:6]:
        answer = tracker.update(picture)
        assert type(answer) is tuple and type(answer[0]) is bool and all(type(v) is int for v in answer[1])
        x, y, w, h = answer[1]
        assert x >= 0 and y >= 0 and picture[y : y + h, x : x + w].shape == (h, w, 3) and w * h > 0
        assert 0 <= tracker.getTrackingScore() <= 1


@pytest.mark.parametrize(
    ("begin", "end", "wanted"), [(-5.0, 3.6, (0, 4)), (-9.0, -2.0, (0, 1)), (12.4, 30.0, (9, 10)), (2.4, 2.45, (2, 3)), (3.5, 6.5, (4, 6))]
)
def test_whole_pixels(begin: float, end: float, wanted: tuple[int, int]) -> None:
    assert cv2_compat._whole(begin, end, 10) == wanted


def test_objects_that_only_numpy_reads_are_pictures(pictures: Any) -> None:
    class Only:
        def __init__(self, picture: Any) -> None:
            self.picture = picture

        def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
            return self.picture

    tracker: Any = cv2_compat.TrackerFoveate.create("fast", {"particles": 60})
    tracker.init(Only(pictures[0]), FIRST)
    assert len(tracker.update(Only(pictures[1]))[1]) == 4


def test_colours_are_blue_green_red(pictures: Any) -> None:
    """The boxes are those of the same tracker on red, green, blue."""
    import foveate

    ours, other = cv2_compat.TrackerFoveate("fast"), foveate.Tracker("fast")
    ours.init(pictures[0][..., ::-1], FIRST)
    other.init(pictures[0], FIRST)
    for picture in pictures[1:4]:
        x, y, w, h = other.update(picture).box
        assert ours.update(picture[..., ::-1])[1] == (round(x), round(y), round(x + w) - round(x), round(y + h) - round(y))
