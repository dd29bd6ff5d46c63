"""Many videos on Ray: a task a video, killed workers are replaced, failures are listed.

    python -m foveate.ray --videos 'clips/*.mp4' --out runs -- --profile fast --no-video

What follows ``--`` goes to ``foveate track``. Each video has a folder ``OUT/NAME`` with the files of ``foveate track``, and a
summary ``OUT/NAME.json``, which appears when everything is whole: a second call passes over videos that have one.
``OUT/failures.txt`` lists videos that failed, with their errors; the exit status is 1 then. The first box of ``NAME.mp4`` is the
first line of ``NAME.txt`` beside it, where ``--init`` is not given.

A video whose worker dies is tried again (``--retries``); one that ``foveate track`` refuses is not, for it would be refused again.
On a cluster ``--videos`` and ``--out`` must be paths that all machines share.
"""

from __future__ import annotations

import argparse
import glob
import importlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def track(video: str, out: str, options: Sequence[str]) -> dict[str, Any]:
    """Tracks through a video with the program, on one thread; answers its summary, or ``{"source", "error"}``."""
    summary = Path(f"{out}.json")
    command = [sys.executable, "-m", "foveate", "track", video, "--out", out, "--json", "--threads", "1", *options]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        return {"source": video, "error": " ".join(lines[-2:]) or f"exit status {done.returncode}"}
    answer: dict[str, Any] = json.loads(done.stdout)
    part = summary.with_name(f".{summary.name}.{os.getpid()}")
    part.write_text(json.dumps(answer, indent=2) + "\n")
    os.replace(part, summary)
    return answer


def videos(patterns: Sequence[str]) -> dict[str, str]:
    """The videos that match, by the names of their results."""
    found: dict[str, str] = {}
    for path in sorted({path for pattern in patterns for path in glob.glob(pattern)}):
        name = Path(path).name if os.path.isdir(path) else Path(path).stem
        if name in found:
            raise SystemExit(f"{path}: its results would be in {name}, as those of {found[name]}; rename one")
        found[name] = path
    if not found:
        raise SystemExit(f"no video matches {' '.join(patterns)}")
    return found


def run(found: dict[str, str], out: Path, options: Sequence[str], retries: int, workers: int | None) -> int:
    """Tracks through all videos that have no summary yet; answers how many failed."""
    try:
        ray: Any = importlib.import_module("ray")
    except ImportError as error:
        raise SystemExit(f"python -m foveate.ray needs the package ray ({error}): pip install ray") from None
    out.mkdir(parents=True, exist_ok=True)
    waiting = [(name, video) for name, video in found.items() if not (out / f"{name}.json").exists()]
    print(f"{len(found)} videos, {len(found) - len(waiting)} finished before", file=sys.stderr)
    began, done = time.monotonic(), 0
    failures: dict[str, str] = {}
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if not ray.is_initialized():
        # RAY_ADDRESS names a cluster; else one is started here.
        ray.init(num_cpus=None if "RAY_ADDRESS" in os.environ else workers, include_dashboard=False, log_to_driver=False)
    task = ray.remote(num_cpus=1, max_retries=retries)(track)
    most = 2 * int(ray.cluster_resources().get("CPU", 1))
    running: dict[Any, str] = {}
    while waiting or running:
        while waiting and len(running) < most:
            name, video = waiting.pop(0)
            running[task.remote(os.path.abspath(video), str((out / name).absolute()), list(options))] = name
        for reference in ray.wait(list(running), timeout=5.0)[0]:
            name = running.pop(reference)
            done += 1
            try:
                answer = ray.get(reference)
            except ray.exceptions.RayError as error:
                answer = {"error": f"its worker died {retries + 1} times: {str(error).splitlines()[0]}"}
            if answer.get("error"):
                failures[found[name]] = str(answer["error"])
            left = len(waiting) + len(running)
            rate = done / (time.monotonic() - began)
            print(f"\r{done} done, {left} left, {len(failures)} failed, {left / rate:.0f} s left ", end="", file=sys.stderr)
    print(file=sys.stderr)
    listed = out / "failures.txt"
    listed.unlink(missing_ok=True)
    if failures:
        listed.write_text("".join(f"{video}\t{error}\n" for video, error in sorted(failures.items())))
    print(f"{done} tracked in {time.monotonic() - began:.1f} s, {len(failures)} failed")
    return len(failures)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; answers the exit status."""
    parser = argparse.ArgumentParser(prog="python -m foveate.ray", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--videos", nargs="+", required=True, metavar="GLOB", help="video files or folders of images")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--retries", type=int, default=3, metavar="N", help="tries after a worker died (3)")
    parser.add_argument("--workers", type=int, default=None, metavar="N", help="processes at a time (all processors)")
    parser.add_argument("options", nargs="*", help="after --: options of foveate track")
    args = parser.parse_args(arguments)
    return 1 if run(videos(args.videos), args.out, args.options, args.retries, args.workers) else 0


if __name__ == "__main__":
    sys.exit(main())
