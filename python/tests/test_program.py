"""The program inside the package, and the same boxes from it and from Python."""

from __future__ import annotations

import csv
import json
import os
import signal
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIRST, sequence

import foveate

Rows = list[tuple[float, ...]]


def program(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "foveate", *arguments], cwd=cwd, capture_output=True, text=True, timeout=600)


def write_png(path: Path, image: Any) -> None:
    height, width = image.shape[:2]
    rows = b"".join(b"\0" + row.tobytes() for row in image)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def tracked(folder: Path, video: Path, first: tuple[float, ...], out: str, *more: str) -> Rows:
    """Left, top, width, height, x, y and P(lost) of the program, from its track.csv, which reads back bit for bit."""
    init = ",".join(str(v) for v in (first[0] + 1, first[1] + 1, *first[2:]))
    done = program("track", str(video), "--init", init, "--no-video", "--no-report", "--out", out, *more, cwd=folder)
    assert done.returncode == 0, done.stderr
    names = ["left", "top", "width", "height", "x", "y", "p_lost"]
    with (folder / out / "track.csv").open() as file:
        return [tuple(float(row[name]) for name in names) for row in list(csv.DictReader(file))[1:]]


def from_python(pictures: Any, first: tuple[float, ...], **settings: Any) -> Rows:
    tracker, rows = foveate.Tracker(**settings), []
    for t, picture in enumerate(pictures):
        if t == 0:
            tracker.init(picture, first)
            continue
        seen = tracker.update(picture)
        rows.append((*seen.box, seen.state.x, seen.state.y, seen.p_lost))
    return rows


def test_a_drawn_sequence_has_the_boxes_of_the_program(pictures: Any, tmp_path: Path) -> None:
    (tmp_path / "video").mkdir()
    for t, picture in enumerate(pictures):
        write_png(tmp_path / "video" / f"{t + 1:04}.png", picture)
    wanted = tracked(tmp_path, tmp_path / "video", FIRST, "out")
    assert len(wanted) == len(pictures) - 1
    assert from_python(pictures, FIRST) == wanted, "NumPy's pictures"
    assert from_python([p[..., ::-1] for p in pictures], FIRST, channels="bgr") == wanted
    assert from_python(foveate.Video(tmp_path / "video"), FIRST) == wanted, "the package's own reader"
    assert from_python(pictures, FIRST, seed=2) == tracked(tmp_path, tmp_path / "video", FIRST, "two", "--seed", "2")
    for read, picture in zip(foveate.Video(tmp_path / "video", channels="bgr"), pictures):
        np.testing.assert_array_equal(read, picture[..., ::-1])


@pytest.mark.parametrize("reference", [None, (5, 70, 30, 30)])
def test_measurements_are_those_of_the_program(pictures: Any, tmp_path: Path, reference: tuple[float, ...] | None) -> None:
    (tmp_path / "video").mkdir()
    for t, picture in enumerate(pictures):
        write_png(tmp_path / "video" / f"{t + 1:04}.png", picture)
    done = program(
        "measure", "video", "--init", "41,31,24,24", "--init", "6,9,30,30", "--names", "ball,wall", "--no-video", "--no-report",
        "--ruler", "1,1,101,1=1.5+-0.01m", "--origin", "21,11", "--angle", "10", "--fps", "50+-0.5", "--fit", "line:x",
        "--fit", "parabola:y:0.1-0.4", *(() if reference is None else ("--reference", "6,71,30,30")), cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    points = foveate.measure(
        foveate.Video(tmp_path / "video"), {"ball": FIRST, "wall": (5, 8, 30, 30)}, ruler=(0, 0, 100, 0, 1.5, 0.01), origin=(20, 10),
        angle=10, fps=(50, 0.5), fit=["line:x", "parabola:y:0.1-0.4"], reference=reference,
    )  # fmt: skip
    wanted = json.loads((tmp_path / "out" / "fits.json").read_text())["fits"]
    with (tmp_path / "out" / "measure.csv").open() as file:
        rows = list(csv.DictReader(file))
    for name, measured in points.items():
        mine = [row for row in rows if row["point"] == name]
        assert len(mine) == len(measured.frame) == len(pictures)
        units = {"position": ("", "m"), "velocity": ("v", "m/s"), "acceleration": ("a", "m/s^2")}
        for field, (prefix, unit) in units.items():
            for start in ("", "sd_"):
                table = [[float(row[f"{start}{prefix}{axis} ({unit})"]) for axis in "xy"] for row in mine]
                np.testing.assert_array_equal(getattr(measured, start + field), table)
        tracked = [[float(row[f"tracked_{axis} (m)"] or "nan") for axis in "xy"] for row in mine]
        np.testing.assert_array_equal(measured.tracked, tracked)
        np.testing.assert_array_equal(measured.time, [float(row["t (s)"]) for row in mine])
        np.testing.assert_array_equal(measured.p_lost, [float(row["p_lost"]) for row in mine])
        assert measured.status == [row["status"] for row in mine]
        assert [int(row["frame"]) - 1 for row in mine] == measured.frame.tolist()
        fits = [fit for fit in wanted if fit["point"] == name]
        assert len(fits) == len(measured.fits) == 2
        for fit, got in zip(fits, measured.fits):
            assert (fit["fit"], fit["t0"], fit["rms"], fit["points"]) == (got.fit, got.t0, got.rms, got.points)
            values = {v["name"]: (v["value"], v["error"], tuple(v["interval"]), v["unit"]) for v in fit["values"]}
            assert values == {key: tuple(value) for key, value in got.values.items()}
    assert 2.0 < points["ball"].fits[0].values["v"].value < 2.4, "3 px to the right and 1 px down a picture, axes turned by 10 degrees"
    single = foveate.measure(pictures, FIRST, fps=25)
    assert single.unit == "px" and single.position.shape == (len(pictures), 2) and not single.fits
    doubtful = foveate.measure(pictures, FIRST, fps=25, fit=["line:x", "exponential:x", "sine:y:0.01-0.02"])
    assert len(doubtful.fits) == 2, "two fits, and notes on one of them and on the third"
    assert [note.split(":")[0] for note in doubtful.notes] == ["No decay exponential", "No fit sine"], doubtful.notes
    for wrong in ({}, {"fps": 0.0}, {"fps": 25, "fit": "cubic:y"}, {"fps": 25, "ruler": (1, 1, 1, 1, 1.0)}, {"fps": 25, "ruler": (1, 1)}):
        with pytest.raises(foveate.InputError):
            foveate.measure(pictures, FIRST, **wrong)
    decay = doubtful.fits[1].values["tau"]
    assert decay.interval[0] > 0 and decay.interval[1] == float("inf"), "the note says that there is no upper end"
    lens = tmp_path / "lens.json"
    matrix = {"camera_matrix": {"data": [100, 0, 50, 0, 100, 50, 0, 0, 1]}, "distortion_coefficients": {"data": [0, 0, 0, 0, 0]}}
    lens.write_text(json.dumps({"image_width": 640, "image_height": 480, **matrix}))
    with pytest.raises(foveate.InputError, match="640 x 480"):
        foveate.measure(pictures, FIRST, fps=25, lens=lens)


@pytest.mark.parametrize("name", ["Car1", "Couple", "Crossing", "Dog1", "DragonBaby"])
def test_sequences_have_the_boxes_of_the_program(name: str, tmp_path: Path) -> None:
    folder = sequence(name)
    numbers = (folder / "groundtruth_rect.txt").read_text().split("\n")[0].replace("\t", ",").split(",")
    x, y, w, h = (float(n) for n in numbers)
    first = (x - 1, y - 1, w, h)
    wanted = tracked(tmp_path, folder / "img", first, "out", "--until", "60")
    pictures = [picture for picture, _ in zip(foveate.Video(folder / "img"), range(len(wanted) + 1))]
    assert len(wanted) > 50 and from_python(pictures, first) == wanted


def test_many_targets_have_the_boxes_of_the_program(tmp_path: Path) -> None:
    folder = sequence("../mot/TUD-Campus")
    found: dict[int, list[list[float]]] = {}
    for line in (folder / "det" / "det.txt").read_text().splitlines():
        frame, _, x, y, *rest = (float(word) for word in line.split(","))
        found.setdefault(int(frame) - 1, []).append([x - 1, y - 1, *rest[:3]])
    video, detections = str(folder / "img1"), str(folder / "det" / "det.txt")
    done = program("track", video, "--detections", detections, "--until", "30", "--no-video", "--no-report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out" / "tracks.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["phase"] != "lost"]  # Python has the active targets
    wanted = [(int(row["frame"]) - 1, int(row["id"]), *(float(row[name]) for name in ("x", "y", "deficit"))) for row in rows]
    tracker, mine = foveate.MultiTracker(), []
    for t, picture in zip(range(30), foveate.Video(video)):
        targets = tracker.update(picture, found.get(t, []))
        mine += [(t, i, *s[:2], d) for i, s, d in zip(targets.ids.tolist(), targets.states.tolist(), targets.deficit.tolist())]
    assert len(mine) > 60 and mine == wanted


def test_videos_that_cannot_be_read_say_so(tmp_path: Path) -> None:
    with pytest.raises(foveate.FileError, match="none.mp4"):
        foveate.Video(tmp_path / "none.mp4")
    with pytest.raises(foveate.InputError, match="rgba"):
        foveate.Video(tmp_path, channels="rgba")  # type: ignore[arg-type]


def test_the_program_answers_and_fails_as_it_should(tmp_path: Path) -> None:
    assert program("--version", cwd=tmp_path).stdout.startswith("foveate ")
    assert "natural-fast" in program("configs", cwd=tmp_path).stdout
    failed = program("track", "none.mp4", "--init", "1,2,3,4", cwd=tmp_path)
    assert failed.returncode == 1 and "none.mp4" in failed.stderr and "Traceback" not in failed.stderr
    assert program("no-such-command", cwd=tmp_path).returncode == 2
    script = Path(sys.executable).with_name("foveate")
    if script.exists():
        assert subprocess.run([script, "--version"], capture_output=True).returncode == 0


@pytest.mark.skipif(os.name != "posix", reason="skipped: no signals")
@pytest.mark.parametrize("arguments", [["eval", "--help"], ["synth", "clutter", "--frames", "20000", "--out", "video"]])
def test_ctrl_c_ends_it(arguments: list[str], tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "foveate", *arguments], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    # It is at work, however long Python took to begin; help is soon at its end.
    until = time.monotonic() + 60
    while process.poll() is None and not any(tmp_path.iterdir()) and time.monotonic() < until:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, messages = process.communicate(timeout=30)
    assert "Traceback" not in messages
    assert process.returncode != 0 or arguments[-1] == "--help"


def test_ctrl_c_while_tracking_leaves_whole_files(tmp_path: Path) -> None:
    done = program("synth", "clutter", "--frames", "400", "--out", "video", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    process = subprocess.Popen(
        [sys.executable, "-m", "foveate", "track", "video", "--init", "1,1,28,28", "--set", "particles=20000", "--out", "out"],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(3)
    process.send_signal(signal.SIGINT)
    _, messages = process.communicate(timeout=60)
    if process.returncode == 0:
        pytest.skip("skipped: it ended before it was stopped")
    assert process.returncode == 130 and "good order" in messages, messages
