"""Many videos, or the runs of an evaluation, on Ray: killed workers are replaced, failures are listed.

    python -m foveate.ray --videos 'clips/*.mp4' --out runs -- --profile fast --no-video
    python -m foveate.ray eval --out out-eval -- --seqs data/tracking --seeds 5

What follows ``--`` goes to ``foveate track`` or ``foveate eval``.

Videos: a task each. Each video has a folder ``OUT/NAME`` with the files of ``foveate track``, and a summary ``OUT/NAME.json``,
which appears when everything is whole: a second call passes over videos that have one. ``OUT/index.html`` has all, the worst first;
``OUT/failures.txt`` lists videos that failed, with their errors; the exit status is 1 then. The first box of ``NAME.mp4`` is the first line of ``NAME.txt`` beside it,
where ``--init`` is not given. A video that ``foveate track`` refuses is not tried again, for it would be refused again.

``'s3://bucket/*.mp4'`` and other addresses that the package fsspec supports work, too, for videos and for ``--out``: each task copies its
video to its machine, and its results from there when they are whole, the summary last.

``eval``: a task for each of ``--parts`` shards of the runs (``--shard``), which keep them in ``OUT/runs``; then the
program itself makes tables and page of them, here. A second call does only the runs that are not there yet.

What a worker that dies was doing is tried again, ``--retries`` times. On a cluster all paths, this folder among them, must be shared by
all machines.
"""

from __future__ import annotations

import argparse
import ctypes
import html
import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.parse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from . import __main__ as program
from . import _places
from ._foveate import document
from ._types import counted
from .errors import FileError

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
    """Tracks through a video with the program; its results are a folder OUT, its summary OUT.json, written last. Answers the error."""
    with tempfile.TemporaryDirectory() as near:
        path = _places.fetch(video, near) if _places.is_address(video) else video
        here = os.path.join(near, "results") if _places.is_address(out) else out
        printed, error = _called(["track", path, "--out", here, "--json", *options], folder)
        if error:
            return error
        if here != out:
            _places.upload(here, out)
        summary = json.loads(printed)
        outputs = [output.replace(here, out, 1) for output in summary["outputs"]]
        made = {**summary, "source": video, "options": list(options), "outputs": outputs}
        _places.write(f"{out}.json", json.dumps(made, indent=2) + "\n")
    return ""


def part(command: Sequence[str], out: str, which: str, options: Sequence[str], folder: str = ".") -> str:
    """Does a shard of the runs of ``foveate eval``, such as ``"1/4"``; answers the error."""
    with _places.nearby(out) as here:
        return _called([*command, "--out", here, "--shard", which, *options], folder)[1]


def videos(patterns: Sequence[str]) -> dict[str, str]:
    """The videos that match, by the names of their results."""
    found: dict[str, str] = {}
    for path in sorted({path for pattern in patterns for path in _places.matching(pattern)}):
        name = Path(path).name if os.path.isdir(path) else Path(path).stem
        if name in ("index.html", "failures.txt"):
            raise SystemExit(f"{path}: {name} in the folder for results is a list of all videos; rename the video")
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
                error = f"its worker died {counted(retries + 1, 'time')}: {str(dead).splitlines()[0]}"
            if error:
                failures[name] = error
            left = len(waiting) + len(running)
            rate = done / (time.monotonic() - began)
            print(f"\r{done} done, {left} left, {len(failures)} failed, {left / rate:.0f} s left ", end="", file=sys.stderr)
    print(file=sys.stderr)
    return failures


def page(summaries: Mapping[str, Mapping[str, Any]], failures: Mapping[str, str]) -> str:
    """A table of videos: failures, then those with the largest share of frames that are occluded or lost."""

    def count(name: str, key: str) -> int:
        return int(summaries[name].get(key, 0))  # older summaries of many targets have frames alone

    def share(name: str) -> float:
        return sum(count(name, key) for key in ("occluded_frames", "lost_frames")) / max(1, count(name, "frames"))

    rows = [f"<tr><td>{html.escape(name)}<td colspan=4 class=words>{html.escape(error)}" for name, error in sorted(failures.items())]
    for name in sorted(summaries, key=lambda name: (-share(name), name)):
        report = "report.html" if any(output.endswith("/report.html") for output in summaries[name]["outputs"]) else ""
        counts = "".join(f"<td>{count(name, key)}" for key in ("frames", "occluded_frames", "lost_frames"))
        link = f'<a href="{urllib.parse.quote(name)}/{report}">{html.escape(name)}</a>'
        rows.append(f"<tr><td>{link}{counts}<td>{100 * share(name):.1f}")
    heads = "".join(f"<th>{head}" for head in ("video", "frames", "occluded", "lost", "occluded or lost, %"))
    table = f'<div class="scroll"><table class="numbers"><tr>{heads}\n' + "\n".join(rows) + "\n</table></div>\n"
    return document(f"{counted(len(rows), 'video')}, the worst first", "", "", f'<section class="card">{table}</section>\n')


def finished(root: str, found: Mapping[str, str], options: Sequence[str]) -> set[str]:
    """The videos that have a summary, which must be of the same video with the same options."""
    names = sorted(found.keys() & set(_places.names(root, ".json")))
    for name, text in zip(names, _places.texts(root, [f"{name}.json" for name in names]), strict=True):
        made = json.loads(text)
        for what, now in (("source", found[name]), ("options", list(options))):
            if made.get(what) != now:
                raise SystemExit(f"{root}/{name}.json: its {what} was {made.get(what)}, now {now}; give another --out")
    return set(names)


def run(found: Mapping[str, str], out: str, options: Sequence[str], retries: int, workers: int | None) -> int:
    """Tracks through all videos that have no summary yet; answers how many failed."""
    root = _places.absolute(out)
    before = finished(root, found, options)
    ray = started(workers)
    if not _places.is_address(out):
        os.makedirs(root, exist_ok=True)
    left = {name: video for name, video in found.items() if name not in before}
    print(f"{counted(len(found), 'video')}, {len(found) - len(left)} finished before", file=sys.stderr)
    began, folder = time.monotonic(), os.getcwd()
    # Videos by the paths that were given: the results name them so, as those of one `foveate track`.
    jobs = {name: (video, f"{root}/{name}", list(options), folder) for name, video in left.items()}
    failures = spread(ray, track, jobs, retries)
    lines = [f"{found[name]}\t{error}\n" for name, error in failures.items()]
    if lines:
        _places.write(f"{root}/failures.txt", "".join(sorted(lines)))
    else:
        _places.remove(f"{root}/failures.txt")
    whole = [name for name in found if name not in failures]
    texts = _places.texts(root, [f"{name}.json" for name in whole])
    summaries = {name: json.loads(text) for name, text in zip(whole, texts, strict=True)}
    _places.write(f"{root}/index.html", page(summaries, failures))
    print(f"{len(left) - len(failures)} tracked in {time.monotonic() - began:.1f} s, {len(failures)} failed; {out}/index.html")
    return len(failures)


def run_parts(
    command: Sequence[str], out: str, options: Sequence[str], parts: int | None, retries: int, workers: int | None
) -> int:
    """Does the runs of ``foveate eval`` in parts, then the command itself; answers the exit status."""
    ray = started(workers)
    count = parts or PARTS * processors(ray)
    began, folder, whole = time.monotonic(), os.getcwd(), _places.absolute(out)
    names = [f"{i}/{count}" for i in range(1, count + 1)]
    failures = spread(ray, part, {name: (list(command), whole, name, list(options), folder) for name in names}, retries)
    for error in sorted(set(failures.values())):
        print(f"part {', '.join(name for name in names if failures.get(name) == error)}: {error}", file=sys.stderr)
    if failures:
        print(f"{len(failures)} of {counted(count, 'part')} failed; the same command continues from there", file=sys.stderr)
        return 1
    print(f"{counted(count, 'part')} in {time.monotonic() - began:.1f} s", file=sys.stderr)
    sys.stdout.flush()
    with _places.nearby(whole) as here:
        merge = [*command, "--out", here, "--merge", here, *options]
        status = subprocess.run([sys.executable, "-c", _HERE, *merge]).returncode
    if here != whole:
        print(f"{here} is kept as {out}")
    return status


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; answers the exit status."""
    try:
        return _main(arguments)
    except FileError as error:
        raise SystemExit(str(error)) from None


def _checked(parser: argparse.ArgumentParser, own: Sequence[str]) -> argparse.Namespace:
    """The arguments, if the numbers of tries and processes are possible."""
    args = parser.parse_args(own)
    if args.retries < 0:
        parser.error(f"argument --retries: expected 0 or more, got {args.retries}")
    if args.workers is not None and args.workers < 1:
        parser.error(f"argument --workers: expected 1 or more, got {args.workers}")
    return args


def _main(arguments: Sequence[str] | None) -> int:
    given = list(sys.argv[1:] if arguments is None else arguments)
    end = given.index("--") if "--" in given else len(given)
    own, options = given[:end], given[end + 1 :]
    command = own[0] if own and own[0] == "eval" else None
    about = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="python -m foveate.ray" + f" {command}" * bool(command), description=about)
    parser.epilog = f"After -- options of foveate {command or 'track'}. In place of --videos: eval."
    if command is None:
        parser.add_argument("--videos", nargs="+", required=True, metavar="GLOB", help="video files, folders of images, addresses")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder or address for the results")
    parser.add_argument("--retries", type=int, default=3, metavar="N", help="tries after a worker died (3)")
    parser.add_argument("--workers", type=int, default=None, metavar="N", help="processes at a time (all processors)")
    if command is None:
        args = _checked(parser, own)
        return 1 if run(videos(args.videos), args.out, options, args.retries, args.workers) else 0
    parser.add_argument("--parts", type=int, default=None, metavar="N", help=f"tasks ({PARTS} for each processor)")
    args = _checked(parser, own[1:])
    if args.parts is not None and not 1 <= args.parts <= 100_000:
        parser.error(f"argument --parts: expected 1 to 100000, got {args.parts}")
    return run_parts([command], args.out, options, args.parts, args.retries, args.workers)


if __name__ == "__main__":
    sys.exit(main())
