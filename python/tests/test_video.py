"""Videos as arrays: length, seeking, stride, second loops, patterns, streams, and what trackers make of them."""

from __future__ import annotations

import contextlib
import functools
import http.server
import logging
import os
import shutil
import subprocess
import sys
import threading
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIRST
from test_documents import environment
from test_program import program, write_png

import foveate


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, pictures: Any) -> Path:
    place = tmp_path_factory.mktemp("frames")
    for t, picture in enumerate(pictures[:12]):
        write_png(place / f"f{t + 3:04}.png", picture)
    return place


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory, pictures: Any) -> Path:
    """H.264 in MP4: what the program writes of a track."""
    place = tmp_path_factory.mktemp("film")
    (place / "video").mkdir()
    for t, picture in enumerate(pictures[:12]):
        write_png(place / "video" / f"{t:04}.png", picture)
    init = ",".join(str(v) for v in (FIRST[0] + 1, FIRST[1] + 1, *FIRST[2:]))
    done = program("track", "video", "--profile", "fast", "--init", init, "--out", "out", "--no-report", cwd=place)
    assert done.returncode == 0, done.stderr
    return place / "out" / "annotated.mp4"


def test_a_second_loop_is_not_empty(folder: Path, pictures: Any) -> None:
    video = foveate.Video(folder)
    assert len(video) == 12 and video and [len(list(video)) for _ in range(3)] == [12] * 3
    # A loop that stops goes on where it stopped: the first picture, then the others.
    first = next(iter(video))
    np.testing.assert_array_equal(first, pictures[0])
    assert video.frame == 0 and len(list(video)) == 11 and video.frame == 11


@pytest.mark.parametrize("source", ["folder", "film"])
def test_any_picture_can_be_reached(source: str, request: pytest.FixtureRequest) -> None:
    path = request.getfixturevalue(source)
    video = foveate.Video(path)
    assert len(video) == 12 and video.frame is None and video.time is None
    times, frames = [], []
    for image in video:
        frames.append(image)
        assert video.time is not None and video.frame == len(frames) - 1
        times.append(video.time)
    np.testing.assert_allclose(times, np.arange(12) / video.rate, atol=1e-6)
    for at in (7, 2, 11, 0, 3, 3):
        video.seek(at)
        np.testing.assert_array_equal(next(video), frames[at])
        assert (video.frame, video.time) == (at, times[at])
    for wrong in (12, 1 << 40):
        with pytest.raises(foveate.InputError, match="there is no picture"):
            video.seek(wrong)
    with pytest.raises(OverflowError):
        video.seek(-1)
    few = foveate.Video(path, start=1, every=4)
    for _ in range(2):
        places = [few.frame for _ in few]
        assert places == [1, 5, 9] and len(few) == 3
    with pytest.raises(foveate.InputError, match="1 or more"):
        foveate.Video(path, every=0)
    with pytest.raises(foveate.InputError, match="there is no picture 12"):
        foveate.Video(path, start=12)


def test_with_closes_it(folder: Path) -> None:
    with foveate.Video(folder) as video:
        next(video)
    with pytest.raises(foveate.InputError, match="closed"):
        next(video)


def test_numbered_patterns(folder: Path, pictures: Any) -> None:
    read = list(foveate.Video(folder / "f%04d.png"))
    assert len(read) == 12 and all((a == b).all() for a, b in zip(read, pictures))
    with pytest.raises(foveate.FileError, match="found none"):
        foveate.Video(folder / "g%04d.png")


def test_cameras_have_numbers(tmp_path: Path) -> None:
    if os.path.exists("/dev/video97"):
        pytest.skip("skipped: there is such a camera")
    with pytest.raises(foveate.FileError, match="/dev/video97"):
        foveate.Video(97)
    with pytest.raises(TypeError, match="path, an address or the number of a camera; it is a float"):
        foveate.Video(9.5)  # type: ignore[arg-type]


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None: ...


@contextlib.contextmanager
def served(place: Path) -> Iterator[str]:
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(place)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="skipped: no ffmpeg")
def test_a_stream_ends_once(folder: Path, tmp_path: Path) -> None:
    made = ["ffmpeg", "-v", "error", "-stream_loop", "39", "-start_number", "3", "-i", folder / "f%04d.png", tmp_path / "a.ts"]
    subprocess.run(made, check=True)
    with served(tmp_path) as address:
        video = foveate.Video(f"{address}/a.ts")
        assert {image.shape for image in video} == {(120, 160, 3)} and video.frame is not None
        assert video.dropped >= 0
        with pytest.raises(TypeError, match="known at the end"):
            len(video)
        for again in (lambda: list(video), lambda: video.seek(0)):
            with pytest.raises(foveate.InputError, match="cannot be read again"):
                again()


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="skipped: no ffmpeg")
def test_a_picture_beyond_an_unknown_end_is_an_error(folder: Path, tmp_path: Path) -> None:
    film = tmp_path / "a.mkv"
    subprocess.run(["ffmpeg", "-v", "error", "-start_number", "3", "-i", folder / "f%04d.png", film], check=True)
    with pytest.raises(foveate.InputError, match="there is no picture 500"):
        next(foveate.Video(film, start=500))
    video = foveate.Video(film, every=5)
    assert len(list(video)) == 3
    video.seek(11)
    assert next(video) is not None and next(video, None) is None, "the stride may pass the end"
    video.seek(12)
    with pytest.raises(foveate.InputError, match="there is no picture 12"):
        next(video)
    assert next(video, None) is None and len(list(video)) == 3


def test_a_video_is_followed(folder: Path, pictures: Any) -> None:
    """The same boxes from a path, a video, and pictures; one result for each picture."""
    by_hand = foveate.Tracker("fast")
    wanted = [by_hand.init(pictures[0], FIRST).box, *(by_hand.update(p).box for p in pictures[1:12])]
    assert wanted[0] == FIRST
    for video in (folder, str(folder), foveate.Video(folder), pictures[:12], iter(pictures[:12])):
        seen = list(foveate.Tracker("fast").track(video, FIRST))
        assert [s.box for s in seen] == wanted and [s.frame for s in seen] == list(range(12))
        assert all(s.image is None for s in seen), "who keeps results keeps no pictures"
    timed = list(foveate.Tracker("fast").track(foveate.Video(folder, every=3), FIRST))
    assert [(s.frame, round(s.time * 30)) for s in timed if s.time is not None] == [(0, 0), (3, 3), (6, 6), (9, 9)]
    # Without a box it goes on with the target at hand.
    half = foveate.Tracker("fast")
    boxes = [s.box for s in half.track(pictures[:6], FIRST)] + [s.box for s in half.track(pictures[6:12])]
    assert boxes == wanted
    bgr = foveate.Tracker("fast", channels="bgr")
    assert [s.box for s in bgr.track(folder, FIRST)] == wanted


def test_following_holds_one_picture(pictures: Any) -> None:
    alive: list[weakref.ref[Any]] = []

    def made() -> Iterator[Any]:
        for picture in pictures:
            image = picture.copy()
            alive.append(weakref.ref(image))
            yield image
            del image

    for seen in foveate.Tracker("fast").track(made(), FIRST):
        assert seen.image is alive[-1]() and sum(image() is not None for image in alive) <= 2


def test_what_cannot_be_followed_says_so_at_once(pictures: Any, tmp_path: Path) -> None:
    tracker = foveate.Tracker("fast")
    with pytest.raises(foveate.InputError, match=r"track\(video, box\)"):
        tracker.track(pictures)
    with pytest.raises(TypeError, match="it is NoneType"):
        tracker.track(None, FIRST)  # type: ignore[arg-type]
    with pytest.raises(foveate.FileError, match="none.mp4"):
        tracker.track(tmp_path / "none.mp4", FIRST)


def test_progress(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    list(foveate.Tracker("fast").track(folder, FIRST))
    assert capsys.readouterr().err == "", "no terminal"
    list(foveate.Tracker("fast").track(folder, FIRST, progress=True))
    shown = capsys.readouterr().err
    assert "12/12 pictures [" + 24 * "#" + "]" in shown and shown.endswith("\n")
    list(foveate.Tracker("fast").track(iter(foveate.Video(folder)), FIRST, progress=False))
    assert capsys.readouterr().err == ""


def test_events_are_logged(folder: Path, pictures: Any, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, "foveate")
    blank = np.zeros_like(pictures[0])
    results = list(foveate.Tracker("fast").track([*pictures[:8], *[blank] * 30], FIRST))
    changes = [b.status for a, b in zip(results, results[1:]) if a.status != b.status]
    said = [record.getMessage() for record in caplog.records if record.levelno == logging.INFO]
    assert changes and [text.split(" at ")[0] for text in said] == changes and "P(lost)" in said[0]
    foveate.Video(folder)
    assert "image folder" in caplog.records[-1].getMessage()
    # Without a handler nothing is printed.
    code = "import foveate, sys; foveate.Video(sys.argv[1])"
    done = subprocess.run([sys.executable, "-c", code, folder], capture_output=True, text=True, env=environment())
    assert (done.stdout, done.stderr) == ("", "")


def test_a_run_is_as_long_as_its_pictures(folder: Path) -> None:
    run = foveate.Run.of(foveate.Tracker("fast"), folder, FIRST)
    assert len(run) == len(foveate.Video(folder)) == len(list(run)) == len(run.boxes)
    assert tuple(run[0].box) == FIRST and run[0].p_lost == 0 and run.size == (160, 120)
    assert run.errors([(40 + 3 * t, 30 + t, 24, 24) for t in range(12)])[0] == 0
