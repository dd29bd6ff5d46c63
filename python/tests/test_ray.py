"""Many videos, evaluations and experiments on Ray: the results of the program, killed workers, addresses, second calls."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import foveate.ray
import pytest

from conftest import FIRST, drawn


def report(folder: Path) -> str:
    """The page, without what differs between any two calls: the command and the speed."""
    page = (folder / "report.html").read_text()
    assert "<title>foveate: b</title>" in page
    return re.sub(r'"command":"[^"]*"|"fps":[0-9.]+', "", page)


def test_folders_on_ray(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="skipped: no package ray")
    image = pytest.importorskip("PIL.Image", reason="skipped: no package pillow")
    x, y, w, h = FIRST
    for name, first in (("a", 0), ("b", 3), ("bad", 0)):
        folder = tmp_path / "clips" / name / "img"
        folder.mkdir(parents=True)
        for t in range(6):
            image.fromarray(drawn(first + t)).save(folder / f"{t + 1:04d}.png")
        truth = f"{x + 3 * first + 1},{y + first + 1},{w},{h}\n"
        (folder.parent / "groundtruth_rect.txt").write_text(truth)
    (tmp_path / "clips/bad/img/0003.png").write_bytes(b"no picture")
    program = [sys.executable, "-m", "foveate"]
    command = [sys.executable, "-m", "foveate.ray", "--videos", "clips/*", "--out", "runs", "--workers", "2", "--"]
    options = ["--profile", "fast", "--no-video"]

    def call() -> subprocess.CompletedProcess[str]:
        return subprocess.run(command + options, cwd=tmp_path, capture_output=True, text=True, timeout=240)

    done = call()
    assert done.returncode == 1 and "2 tracked" in done.stdout and "1 failed" in done.stdout, done.stdout + done.stderr
    failures = (tmp_path / "runs/failures.txt").read_text()
    assert failures.startswith("clips/bad\t") and "0003.png" in failures
    assert (tmp_path / "runs/a.json").is_file() and not (tmp_path / "runs/bad.json").exists()
    alone = [*program, "track", "clips/b", "--out", "alone", *options]
    subprocess.run(alone, cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "runs/b/boxes.txt").read_bytes() == (tmp_path / "alone/boxes.txt").read_bytes()
    assert report(tmp_path / "runs/b") == report(tmp_path / "alone")
    (tmp_path / "clips/bad/img/0003.png").unlink()
    done = call()
    assert done.returncode == 0 and "1 tracked" in done.stdout, done.stderr
    assert not (tmp_path / "runs/failures.txt").exists()


OPTIONS = ["--profile", "fast", "--no-video", "--no-report"]


def clip(folder: Path, name: str, first: int = 0) -> None:
    """A video of six frames, and its first box."""
    folder.mkdir(exist_ok=True)
    frames = b"".join(b"FRAME\n" + drawn(first + t)[:, :, 1].tobytes() for t in range(6))
    (folder / f"{name}.y4m").write_bytes(b"YUV4MPEG2 W160 H120 F25:1 Ip A1:1 Cmono\n" + frames)
    x, y, w, h = FIRST
    (folder / f"{name}.txt").write_text(f"{x + 3 * first + 1},{y + first + 1},{w},{h}\n")


def program(folder: Path, *arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "foveate", *arguments], cwd=folder, check=True, capture_output=True, timeout=240)


@pytest.mark.parametrize("kind", ["folder", "address"])
def test_addresses_on_ray(tmp_path: Path, kind: str) -> None:
    """Addresses of files: those of buckets go the same way."""
    pytest.importorskip("ray", reason="skipped: no package ray")
    pytest.importorskip("fsspec", reason="skipped: no package fsspec")
    clip(tmp_path / "clips", "a")
    clip(tmp_path / "clips", "bad")
    (tmp_path / "clips/bad.y4m").write_bytes(b"no video")
    address, out = f"file://{tmp_path}/clips/", {"folder": "runs", "address": f"file://{tmp_path}/runs/"}[kind]
    command = [sys.executable, "-m", "foveate.ray", "--videos", f"{address}*.y4m", "--out", out, "--workers", "1", "--", *OPTIONS]

    def call() -> subprocess.CompletedProcess[str]:
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=240)

    done = call()
    assert done.returncode == 1 and "1 tracked" in done.stdout and "1 failed" in done.stdout, done.stdout + done.stderr
    assert (tmp_path / "runs/failures.txt").read_text().startswith(f"{address}bad.y4m\t")
    summary = json.loads((tmp_path / "runs/a.json").read_text())
    assert summary["source"] == f"{address}a.y4m" and summary["outputs"][0].endswith("runs/a/boxes.txt")
    assert [path.name for path in (tmp_path / "runs").glob(".*")] == []
    index = (tmp_path / "runs/index.html").read_text()
    assert index.index("<td>bad<td colspan=4 class=words>") < index.index('<a href="a/">a</a><td>6<td>0<td>0')
    assert "prefers-color-scheme: dark" in index and "Content-Security-Policy" in index
    program(tmp_path, "track", "clips/a.y4m", "--out", "alone", *OPTIONS)
    assert (tmp_path / "runs/a/boxes.txt").read_bytes() == (tmp_path / "alone/boxes.txt").read_bytes()
    clip(tmp_path / "clips", "bad")
    done = call()
    assert done.returncode == 0 and "1 finished before" in done.stderr and "1 tracked" in done.stdout, done.stderr
    assert not (tmp_path / "runs/failures.txt").exists() and (tmp_path / "runs/bad.json").is_file()
    assert "2 videos" in (tmp_path / "runs/index.html").read_text()


def test_an_upload_that_ends_early_leaves_no_mark(tmp_path: Path) -> None:
    """Whatever was the last thing that was done: only what is whole has a summary, and another try makes it whole."""
    fsspec = pytest.importorskip("fsspec", reason="skipped: no package fsspec")
    from fsspec.implementations.local import LocalFileSystem  # noqa: PLC0415: may be absent

    left = 0

    class Shaky(LocalFileSystem):  # type: ignore[misc]
        """Changes `left` files, no more."""

        protocol = "shaky"

        @classmethod
        def _strip_protocol(cls, path: str) -> str:
            return str(super()._strip_protocol(path.removeprefix("shaky://")))

        def change(self, change: str, *arguments: str) -> None:
            nonlocal left
            left -= 1
            if left < 0:
                raise OSError("the connection is lost")
            getattr(super(), change)(*arguments)

        def put_file(self, *arguments: str) -> None:
            self.change("put_file", *arguments)

        def pipe_file(self, *arguments: str) -> None:
            self.change("pipe_file", *arguments)

        def mv(self, *arguments: str) -> None:
            self.change("mv", *arguments)

        def rm_file(self, *arguments: str) -> None:
            self.change("rm_file", *arguments)

    fsspec.register_implementation("shaky", Shaky, clobber=True)
    clip(tmp_path, "a")
    stale = tmp_path / "runs/a/stale.txt"
    stale.parent.mkdir(parents=True)
    results = {"boxes.txt", "run.json", "track.csv"}
    for changes in range(20):
        stale.write_text("of a call with other options")
        left = changes
        try:
            error = foveate.ray.track(str(tmp_path / "a.y4m"), f"shaky://{tmp_path}/runs/a", OPTIONS)
        except foveate.FileError as lost:
            assert "shaky://" in str(lost) and "the connection is lost" in str(lost)
            assert not (tmp_path / "runs/a.json").exists()
            continue
        assert error == "" and {path.name for path in stale.parent.iterdir()} == results
        break
    assert changes == len(results) + 3, "three files, one that goes, and the summary in two steps"
    assert json.loads((tmp_path / "runs/a.json").read_text())["frames"] == 6


@pytest.fixture
def bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The address of a bucket of a server with S3's interface on this machine, and its file system."""
    for package in ("ray", "s3fs", "moto.server"):
        pytest.importorskip(package, reason=f"skipped: no package {package}")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for name, value in (("ACCESS_KEY_ID", "a"), ("SECRET_ACCESS_KEY", "b"), ("DEFAULT_REGION", "us-east-1")):
        monkeypatch.setenv(f"AWS_{name}", value)
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    command = [sys.executable, "-c", "import sys, moto.server; moto.server.main(sys.argv[1:])", "-p", str(port)]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        for _ in range(200):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
                break
            time.sleep(0.1)
        files = importlib.import_module("s3fs").S3FileSystem(skip_instance_cache=True)
        files.mkdir("videos")
        yield files
        server.terminate()


@pytest.mark.skipif(not Path("/proc/self/stat").is_file(), reason="skipped: no /proc")
def test_a_bucket_on_ray(tmp_path: Path, bucket: Any) -> None:
    """Videos in a bucket, results to a bucket, workers that are killed."""
    names = [f"clip-{i}" for i in range(8)]
    for i, name in enumerate(names):
        clip(tmp_path / "clips", name, i)
    bucket.put(str(tmp_path / "clips") + "/", "videos/clips/", recursive=True)
    again = ["--videos", "s3://videos/clips/*.y4m", "--out", "s3://videos/runs", "--workers", "2", "--", *OPTIONS]
    assert "8 tracked" in on_ray(tmp_path, again, kill=2, task=b"track")
    bucket.invalidate_cache()
    assert {path for path in bucket.ls("videos/runs", detail=False) if "." in path} == {
        "videos/runs/index.html",
        *(f"videos/runs/{name}.json" for name in names),
    }
    for name in names:
        program(tmp_path, "track", f"clips/{name}.y4m", "--out", f"alone/{name}", *OPTIONS)
        for file in ("boxes.txt", "track.csv"):
            assert bucket.cat_file(f"videos/runs/{name}/{file}") == (tmp_path / "alone" / name / file).read_bytes()
    bucket.rm_file("videos/runs/clip-3.json")
    assert "7 finished before" in on_ray(tmp_path, again, kill=0)


def test_without_ray_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(SystemExit, match="pip install ray"):
        foveate.ray.run({}, str(tmp_path / "runs"), [], 1, None)
    with pytest.raises(SystemExit, match="pip install ray"):
        foveate.ray.main(["eval", "--out", str(tmp_path / "runs"), "--", "--seqs", "none"])
    assert not (tmp_path / "runs").exists()


def test_finished_videos_are_those_of_the_same_command(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps({"source": "day1/a.mp4", "options": ["--until", "10"]}))
    found = {"a": "day1/a.mp4", "b": "day1/b.mp4"}
    assert foveate.ray.finished(str(tmp_path), found, ["--until", "10"]) == {"a"}
    for other, options in (({"a": "day2/a.mp4"}, ["--until", "10"]), (found, [])):
        with pytest.raises(SystemExit, match=r"a\.json: its (source|options) was .* give another --out"):
            foveate.ray.finished(str(tmp_path), other, options)
    (tmp_path / "index.html.mp4").touch()
    with pytest.raises(SystemExit, match="rename the video"):
        foveate.ray.videos([str(tmp_path / "index.html.mp4")])


@pytest.mark.parametrize("command", [["--videos", "a.mp4"], ["eval"]])
@pytest.mark.parametrize(("option", "least"), [("--workers", 1), ("--retries", 0)])
def test_impossible_numbers_are_refused(
    command: list[str], option: str, least: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        foveate.ray.main([*command, "--out", str(tmp_path / "out"), option, str(least - 1)])
    assert f"argument {option}: expected {least} or more, got {least - 1}" in capsys.readouterr().err


def running() -> dict[int, tuple[int, bytes]]:
    """Processes, each with its parent and its command line; those that are dead and wait for their parent are left out."""
    found = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                state, parent = (folder / "stat").read_text().rsplit(")", 1)[1].split()[:2]
                if state != "Z":
                    found[int(folder.name)] = (int(parent), (folder / "cmdline").read_bytes())
            except OSError:
                continue
    return found


def tasks(process: int, name: bytes) -> list[int]:
    """Ray's workers that do a task of this name, of those that a process has started."""
    processes = running()

    def descends(one: int) -> bool:
        while one > 1 and one != process:
            one = processes[one][0] if one in processes else 0
        return one == process

    return [one for one, (_, words) in processes.items() if words.startswith(b"ray::" + name) and descends(one)]


def on_ray(folder: Path, arguments: list[str], kill: int, task: bytes = b"part") -> str:
    """Calls `python -m foveate.ray`, and kills so many of its workers that are at work; answers what it prints."""
    command = [sys.executable, "-m", "foveate.ray", *arguments]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        killed: set[int] = set()
        while process.poll() is None and len(killed) < kill:
            for worker in set(tasks(process.pid, task)) - killed:
                time.sleep(0.3)
                programs = [one for one, (parent, _) in running().items() if parent == worker]
                os.kill(worker, signal.SIGKILL)
                killed.add(worker)
                time.sleep(0.5)
                left = running()
                assert not any(one in left for one in programs), "its program goes on"
                break
            time.sleep(0.05)
        printed, _ = process.communicate(timeout=240)
    assert process.returncode == 0, printed
    assert len(killed) == kill, "it ended before its workers were killed"
    return printed


@pytest.mark.skipif(not Path("/proc/self/stat").is_file(), reason="skipped: no /proc")
def test_an_evaluation_on_ray(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="skipped: no package ray")

    for digit in ("3", "7"):
        program(tmp_path, "synth", "clutter", "--digit", digit, "--frames", "60", "--out", f"seqs/video-{digit}")
    options = ["--seqs", "seqs", "--config", "digits", "--seeds", "4"]
    program(tmp_path, "eval", "--out", "alone", *options)
    on_ray(tmp_path, ["eval", "--out", "shared", "--workers", "2", "--parts", "3", "--", *options], kill=2)
    for name in ("confidence.json", "reliability.svg", "foveate/seed-4/video-7.txt"):
        assert (tmp_path / "shared" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes(), name
    if importlib.util.find_spec("fsspec"):
        address = f"file://{tmp_path}/far"
        on_ray(tmp_path, ["eval", "--out", address, "--workers", "2", "--parts", "3", "--", *options], kill=1)
        for name in ("confidence.json", "reliability.svg", "foveate/seed-4/video-7.txt"):
            assert (tmp_path / "far" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes(), name


def test_a_refusal_of_the_program_is_reported_once(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="skipped: no package ray")
    command = [sys.executable, "-m", "foveate.ray", "eval", "--out", "out", "--workers", "1", "--parts", "2", "--", "--seqs", "none"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=240)
    assert done.returncode == 1 and "part 1/2, 2/2: " in done.stderr and "none" in done.stderr, done.stderr
    assert "Traceback" not in done.stderr and not (tmp_path / "out").exists()
