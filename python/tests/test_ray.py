"""Many videos on Ray: the boxes of the program, failures listed, a second call that has nothing to do."""

from __future__ import annotations

import subprocess
import sys
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


def test_without_ray_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(SystemExit, match="pip install ray"):
        foveate.ray.run({}, tmp_path / "runs", [], 1, None)
    assert not (tmp_path / "runs").exists()
