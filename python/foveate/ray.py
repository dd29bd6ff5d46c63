"""Many videos, or the runs of an experiment, on Ray: killed workers are replaced, failures are listed.

    python -m foveate.ray --videos 'clips/*.mp4' --out runs -- --profile fast --no-video
    python -m foveate.ray reproduce table1 --out out/table1 -- --data data
    python -m foveate.ray eval --out out-eval -- --seqs data/tracking --seeds 5

What follows ``--`` goes to ``foveate track``, ``foveate reproduce`` or ``foveate eval``.

Videos: a task each. Each video has a folder ``OUT/NAME`` with the files of ``foveate track``, and a summary ``OUT/NAME.json``,
which appears when everything is whole: a second call passes over videos that have one. ``OUT/failures.txt`` lists videos that
failed, with their errors; the exit status is 1 then. The first box of ``NAME.mp4`` is the first line of ``NAME.txt`` beside it,
where ``--init`` is not given. A video that ``foveate track`` refuses is not tried again, for it would be refused again.
``'s3://bucket/*.mp4'`` and other addresses that the package fsspec knows work, too: each task copies its video.

``reproduce`` and ``eval``: a task for each of ``--parts`` parts of the runs (``--shard``), which keep them in ``OUT/runs``; then the
program itself makes tables and page of them, here. A second call does only the runs that are not there yet.

What a worker that dies was doing is tried again, ``--retries`` times. On a cluster all paths, this folder among them, must be shared by
all machines.
"""

from __future__ import annotations

import argparse
import ctypes
import glob
import importlib
import json
import os
import signal
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from . import __main__ as program

PARTS = 4
"""Parts of the runs for each processor."""

_HERE = "import sys, foveate.ray; sys.exit(foveate.ray._run_program())"
"""The program in a Python of its own."""


def _run_program() -> int:
    """Runs the program with this process' arguments; on Linux the process ends when the worker that started it is killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    sys.argv[0] = "foveate"
    return program.main()


def _called(arguments: Sequence[str], folder: str) -> tuple[str, str]:
    """What the program prints, and its error, empty where there is none; on one thread."""
    command = [sys.executable, "-c", _HERE, *arguments, "--threads", "1"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return done.stdout, "" if done.returncode == 0 else " ".join(lines[-2:]) or f"exit status {done.returncode}"


def track(video: str, out: str, options: Sequence[str], folder: str = ".") -> str:
    """Tracks through a video with the program, and keeps its summary beside its folder; answers the error."""
    if "://" in video:
        with tempfile.TemporaryDirectory() as near:
            return _tracked(_fetched(video, near), video, out, options, folder)
    return _tracked(video, video, out, options, folder)


def _tracked(path: str, video: str, out: str, options: Sequence[str], folder: str) -> str:
    """Tracks through the video at a path, that is called otherwise where it is a copy."""
    printed, error = _called(["track", path, "--out", out, "--json", *options], folder)
    if not error:
        summary = Path(f"{out}.json")
        part = summary.with_name(f".{summary.name}.{os.getpid()}")
        part.write_text(json.dumps({**json.loads(printed), "source": video}, indent=2) + "\n")
        os.replace(part, summary)
    return error


def _files(address: str) -> Any:
    """The file system of an address, and its path there."""
    try:
        fsspec: Any = importlib.import_module("fsspec")
        return fsspec.url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise SystemExit(f"{address} needs the package fsspec, and one for this kind of address, such as s3fs: {error}") from None


def _fetched(video: str, folder: str) -> str:
    """A copy of the video and of the file of its first box, if there is one, in a folder; answers its path."""
    files, path = _files(video)
    first = f"{path.rsplit('.', 1)[0]}.txt"
    for name in (path, first):
        if name == path or files.exists(name):
            with files.open(name, "rb") as source, open(os.path.join(folder, os.path.basename(name)), "wb") as copy:
                shutil.copyfileobj(source, copy)
    return os.path.join(folder, os.path.basename(path))


def _matching(pattern: str) -> list[str]:
    """The videos that a pattern names; in an address as addresses."""
    if "://" not in pattern:
        return glob.glob(pattern)
    files, path = _files(pattern)
    return [files.unstrip_protocol(found) for found in files.glob(path)]


def part(command: Sequence[str], out: str, which: str, options: Sequence[str], folder: str = ".") -> str:
    """Does a part of the runs of ``foveate reproduce`` or ``eval``, such as ``"1/4"``; answers the error."""
    return _called([*command, "--out", out, "--shard", which, *options], folder)[1]


def videos(patterns: Sequence[str]) -> dict[str, str]:
    """The videos that match, by the names of their results."""
    found: dict[str, str] = {}
    for path in sorted({path for pattern in patterns for path in _matching(pattern)}):
        name = Path(path).name if os.path.isdir(path) else Path(path).stem
        if name in found:
            raise SystemExit(f"{path}: its results would be in {name}, as those of {found[name]}; rename one")
        found[name] = path
    if not found:
        raise SystemExit(f"no video matches {' '.join(patterns)}")
    return found


def started(workers: int | None) -> Any:
    """Ray, on the cluster that ``RAY_ADDRESS`` names; else one is started here."""
    try:
        ray: Any = importlib.import_module("ray")
    except ImportError as error:
        raise SystemExit(f"python -m foveate.ray needs the package ray ({error}): pip install ray") from None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if not ray.is_initialized():
        ray.init(num_cpus=None if "RAY_ADDRESS" in os.environ else workers, include_dashboard=False, log_to_driver=False)
    return ray


def processors(ray: Any) -> int:
    """How many tasks Ray runs at a time."""
    return max(1, int(ray.cluster_resources().get("CPU", 1)))


def spread(ray: Any, work: Callable[..., str], jobs: Mapping[str, tuple[Any, ...]], retries: int) -> dict[str, str]:
    """Does a task for each job; answers the errors of those that failed."""
    task = ray.remote(num_cpus=1, max_retries=retries)(work)
    began, done, most = time.monotonic(), 0, 2 * processors(ray)
    waiting, failures = list(jobs.items()), {}
    running: dict[Any, str] = {}
    while waiting or running:
        while waiting and len(running) < most:
            name, job = waiting.pop(0)
            running[task.remote(*job)] = name
        for reference in ray.wait(list(running), timeout=5.0)[0]:
            name = running.pop(reference)
            done += 1
            try:
                error = ray.get(reference)
            except ray.exceptions.RayTaskError as failed:
                error = f"{type(failed.cause).__name__}: {failed.cause}".splitlines()[0]
            except ray.exceptions.RayError as dead:
                error = f"its worker died {retries + 1} times: {str(dead).splitlines()[0]}"
            if error:
                failures[name] = error
            left = len(waiting) + len(running)
            rate = done / (time.monotonic() - began)
            print(f"\r{done} done, {left} left, {len(failures)} failed, {left / rate:.0f} s left ", end="", file=sys.stderr)
    print(file=sys.stderr)
    return failures


def run(found: Mapping[str, str], out: Path, options: Sequence[str], retries: int, workers: int | None) -> int:
    """Tracks through all videos that have no summary yet; answers how many failed."""
    ray = started(workers)
    out.mkdir(parents=True, exist_ok=True)
    left = {name: video for name, video in found.items() if not (out / f"{name}.json").exists()}
    print(f"{len(found)} videos, {len(found) - len(left)} finished before", file=sys.stderr)
    began, folder = time.monotonic(), os.getcwd()
    places = {name: video if "://" in video else os.path.abspath(video) for name, video in left.items()}
    jobs = {name: (place, str((out / name).absolute()), list(options), folder) for name, place in places.items()}
    failures = {found[name]: error for name, error in spread(ray, track, jobs, retries).items()}
    listed = out / "failures.txt"
    listed.unlink(missing_ok=True)
    if failures:
        listed.write_text("".join(f"{video}\t{error}\n" for video, error in sorted(failures.items())))
    print(f"{len(left)} tracked in {time.monotonic() - began:.1f} s, {len(failures)} failed")
    return len(failures)


def run_parts(
    command: Sequence[str], out: Path, options: Sequence[str], parts: int | None, retries: int, workers: int | None
) -> int:
    """Does the runs of ``foveate reproduce`` or ``eval`` in parts, then the command itself; answers the exit status."""
    ray = started(workers)
    count = parts or PARTS * processors(ray)
    began, folder, whole = time.monotonic(), os.getcwd(), str(out.absolute())
    names = [f"{i}/{count}" for i in range(1, count + 1)]
    failures = spread(ray, part, {name: (list(command), whole, name, list(options), folder) for name in names}, retries)
    for error in sorted(set(failures.values())):
        print(f"part {', '.join(name for name in names if failures.get(name) == error)}: {error}", file=sys.stderr)
    if failures:
        print(f"{len(failures)} of {count} parts failed; the same command goes on from there", file=sys.stderr)
        return 1
    print(f"{count} parts in {time.monotonic() - began:.1f} s", file=sys.stderr)
    merge = ["--merge", whole] if command[0] == "eval" else []
    sys.stdout.flush()
    return subprocess.run([sys.executable, "-c", _HERE, *command, "--out", whole, *merge, *options]).returncode


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; answers the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    end = given.index("--") if "--" in given else len(given)
    own, options = given[:end], given[end + 1 :]
    command = own[0] if own and own[0] in ("reproduce", "eval") else None
    about = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="python -m foveate.ray" + f" {command}" * bool(command), description=about)
    parser.epilog = f"After -- options of foveate {command or 'track'}. In place of --videos: reproduce NAME ..., or eval."
    if command is None:
        parser.add_argument("--videos", nargs="+", required=True, metavar="GLOB", help="video files, folders of images, addresses")
    if command == "reproduce":
        parser.add_argument("names", nargs="*", metavar="NAME", help="experiments, as foveate reproduce has them")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--retries", type=int, default=3, metavar="N", help="tries after a worker died (3)")
    parser.add_argument("--workers", type=int, default=None, metavar="N", help="processes at a time (all processors)")
    if command is None:
        args = parser.parse_args(own)
        return 1 if run(videos(args.videos), args.out, options, args.retries, args.workers) else 0
    parser.add_argument("--parts", type=int, default=None, metavar="N", help=f"tasks ({PARTS} for each processor)")
    args = parser.parse_args(own[1:])
    if args.parts is not None and not 1 <= args.parts <= 100_000:
        parser.error(f"argument --parts: expected 1 to 100000, got {args.parts}")
    words = [command, *getattr(args, "names", [])]
    return run_parts(words, args.out, options, args.parts, args.retries, args.workers)


if __name__ == "__main__":
    sys.exit(main())
