"""A tracker over a whole video, a picture at a time."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from ._foveate import Tracker, Video
from ._result import LOG, Result
from .errors import InputError


def track(tracker: Tracker, source: object, box: Sequence[float] | None, progress: bool | None) -> Iterator[Result]:
    """Returns the results of :meth:`Tracker.track`. Wrong arguments raise here, not at the first picture."""
    if box is None and not tracker.has_target:
        raise InputError("the tracker has no target: give its box in the first picture, track(video, box)")
    opened: Video | None = None
    if isinstance(source, (str, os.PathLike, int)):
        opened = Video(source, channels="bgr" if tracker.channels.startswith("bgr") else "rgb")
    elif not isinstance(source, Iterable):
        raise TypeError(f"video is a Video, a path, a camera index or pictures one after the other; it is {type(source).__name__}")
    shown = sys.stderr.isatty() if progress is None else progress
    return _results(tracker, opened or source, opened, box, shown)


def _results(
    tracker: Tracker, images: Any, opened: Video | None, box: Sequence[float] | None, shown: bool
) -> Iterator[Result]:
    video = images if isinstance(images, Video) else None
    with opened or contextlib.nullcontext(), _Progress(_length(images), shown) as progress:
        for at, image in enumerate(images):
            if video is not None and video.time is not None:
                tracker.set_time(video.time)
            seen = tracker.init(image, box) if at == 0 and box is not None else tracker.update(image)
            seen.image, seen.frame, seen.time = image, at, None
            if video is not None:
                seen.frame, seen.time = video.frame, video.time
            progress.step()
            try:
                yield seen
            finally:
                # Stored results hold no pictures.
                seen.image = None
        LOG.debug("followed the target through %d pictures", progress.count)


def _length(images: object) -> int | None:
    try:
        return len(images)  # type: ignore[arg-type]
    except TypeError:
        return images.frames if isinstance(images, Video) else None


class _Progress:
    """A line on standard error, at most ten times a second."""

    def __init__(self, total: int | None, shown: bool) -> None:
        self.total, self.shown, self.count = total, shown, 0
        self.began = self.last = time.monotonic()

    def __enter__(self) -> _Progress:
        return self

    def step(self) -> None:
        self.count += 1
        now = time.monotonic()
        if self.shown and (now - self.last > 0.1 or self.count == 1):
            self.last = now
            self._write("")

    def _write(self, end: str) -> None:
        rate = self.count / max(time.monotonic() - self.began, 1e-9)
        known = self.total is not None and self.total >= self.count
        of, bar = "", ""
        if known and self.total:
            done = 24 * self.count // self.total
            of, bar = f"/{self.total}", f" [{'#' * done}{'.' * (24 - done)}]"
        sys.stderr.write(f"\r{self.count}{of} pictures{bar} {rate:.0f} a second\x1b[K{end}")
        sys.stderr.flush()

    def __exit__(self, *_: object) -> None:
        if self.shown and self.count:
            self._write("\n")
