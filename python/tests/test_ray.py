"""Many videos, evaluations and experiments on Ray: the results of the program, killed workers, a second call that has nothing to do."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import foveate.ray
import pytest

from conftest import FIRST, drawn


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
    options = ["--profile", "fast", "--no-video", "--no-report"]

    def call() -> subprocess.CompletedProcess[str]:
        return subprocess.run(command + options, cwd=tmp_path, capture_output=True, text=True, timeout=240)

    done = call()
    assert done.returncode == 1 and "3 tracked" in done.stdout, done.stderr
    failures = (tmp_path / "runs/failures.txt").read_text()
    assert failures.startswith("clips/bad\t") and "0003.png" in failures
    assert (tmp_path / "runs/a.json").is_file() and not (tmp_path / "runs/bad.json").exists()
    alone = [*program, "track", "clips/b", "--out", "alone", *options]
    subprocess.run(alone, cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "runs/b/boxes.txt").read_bytes() == (tmp_path / "alone/boxes.txt").read_bytes()
    (tmp_path / "clips/bad/img/0003.png").unlink()
    done = call()
    assert done.returncode == 0 and "1 tracked" in done.stdout, done.stderr
    assert not (tmp_path / "runs/failures.txt").exists()


def test_addresses_on_ray(tmp_path: Path) -> None:
    """Addresses of files: those of buckets go the same way."""
    pytest.importorskip("ray", reason="skipped: no package ray")
    pytest.importorskip("fsspec", reason="skipped: no package fsspec")
    x, y, w, h = FIRST
    (tmp_path / "clips").mkdir()
    for name in ("a", "bad"):
        frames = b"".join(b"FRAME\n" + drawn(t)[:, :, 1].tobytes() for t in range(6))
        head = b"YUV4MPEG2 W160 H120 F25:1 Ip A1:1 Cmono\n"
        (tmp_path / f"clips/{name}.y4m").write_bytes(head + frames if name == "a" else b"no video")
        (tmp_path / f"clips/{name}.txt").write_text(f"{x + 1},{y + 1},{w},{h}\n")
    options = ["--profile", "fast", "--no-video", "--no-report"]
    address = f"file://{tmp_path}/clips/"
    command = [sys.executable, "-m", "foveate.ray", "--videos", f"{address}*.y4m", "--out", "runs", "--workers", "1", "--", *options]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=240)
    assert done.returncode == 1 and "2 tracked" in done.stdout, done.stderr
    assert (tmp_path / "runs/failures.txt").read_text().startswith(f"{address}bad.y4m\t")
    assert json.loads((tmp_path / "runs/a.json").read_text())["source"] == f"{address}a.y4m"
    alone = [sys.executable, "-m", "foveate", "track", "clips/a.y4m", "--out", "alone", *options]
    subprocess.run(alone, cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "runs/a/boxes.txt").read_bytes() == (tmp_path / "alone/boxes.txt").read_bytes()
    with pytest.raises(SystemExit, match="needs the package fsspec"):
        foveate.ray.videos(["nobody-knows-this://a/*.mp4"])


def test_without_ray_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(SystemExit, match="pip install ray"):
        foveate.ray.run({}, tmp_path / "runs", [], 1, None)
    with pytest.raises(SystemExit, match="pip install ray"):
        foveate.ray.main(["reproduce", "table3", "--out", str(tmp_path / "runs"), "--", "--quick"])
    assert not (tmp_path / "runs").exists()


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


def on_ray(folder: Path, arguments: list[str], kill: int) -> str:
    """Calls `python -m foveate.ray`, and kills so many of its workers that are at work; answers what it prints."""
    command = [sys.executable, "-m", "foveate.ray", *arguments]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        killed: set[int] = set()
        while process.poll() is None and len(killed) < kill:
            for worker in set(tasks(process.pid, b"part")) - killed:
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
def test_evaluation_and_experiments_on_ray(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray", reason="skipped: no package ray")

    def program(*arguments: str) -> None:
        command = [sys.executable, "-m", "foveate", *arguments]
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=240)

    for digit in ("3", "7"):
        program("synth", "clutter", "--digit", digit, "--frames", "60", "--out", f"seqs/video-{digit}")
    options = ["--seqs", "seqs", "--config", "digits", "--seeds", "4"]
    program("eval", "--out", "alone", *options)
    on_ray(tmp_path, ["eval", "--out", "shared", "--workers", "2", "--parts", "3", "--", *options], kill=2)
    for name in ("confidence.json", "reliability.svg", "foveate/seed-4/video-7.txt"):
        assert (tmp_path / "shared" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes(), name

    # The digits are drawn where there are no data.
    monkeypatch.setenv("FOVEATE_DATA", str(tmp_path))
    options = ["--quick"]
    program("reproduce", "table3", "--out", "one", *options)
    again = ["reproduce", "table3", "--out", "many", "--workers", "2"]
    on_ray(tmp_path, [*again, "--parts", "3", "--", *options], kill=2)
    for name in ("table3.json", "table3.csv"):
        assert (tmp_path / "many" / name).read_bytes() == (tmp_path / "one" / name).read_bytes(), name
    # Again: nothing is left to do, in any number of parts.
    before = sorted((path.name, path.stat().st_mtime_ns) for path in (tmp_path / "many/runs").iterdir())
    on_ray(tmp_path, [*again, "--parts", "2", "--", *options], kill=0)
    assert sorted((path.name, path.stat().st_mtime_ns) for path in (tmp_path / "many/runs").iterdir()) == before


def test_what_the_program_refuses_is_told_once(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="skipped: no package ray")
    command = [sys.executable, "-m", "foveate.ray", "eval", "--out", "out", "--workers", "1", "--parts", "2", "--", "--seqs", "none"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=240)
    assert done.returncode == 1 and "part 1/2, 2/2: " in done.stderr and "none" in done.stderr, done.stderr
    assert "Traceback" not in done.stderr and not (tmp_path / "out").exists()
