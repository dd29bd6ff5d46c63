"""Boxes in the files of other programs."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Literal

from ._foveate import export_boxes
from ._multi import Targets
from ._result import LOG, Result
from ._types import Box

Format = Literal["coco", "cvat", "got10k", "label-studio", "mot", "napari", "otb", "trackmate", "viame", "vot", "yolo"]


def export(
    results: Iterable[Result | Targets],
    path: str | os.PathLike[str],
    format: Format,
    *,
    size: tuple[int, int] | None = None,
    guesses: bool = False,
) -> None:
    """Writes the boxes of a video to a file of another program.

    Parameters
    ----------
    results : results or targets
        One for each picture of the video, in order.
    path : path
        The file; of ``"yolo"`` the folder, for labels ``000001.txt`` and so on. It is replaced where it is there.
    format : str
        ``"coco"`` (JSON), ``"cvat"`` (CVAT for video 1.1), ``"label-studio"``, ``"mot"`` (MOTChallenge), ``"napari"``, ``"trackmate"``, ``"viame"``, ``"yolo"``; of one
        target also ``"otb"``, ``"vot"`` and ``"got10k"``.
    size : (width, height), optional
        Of the pictures; ``"label-studio"`` and ``"yolo"`` need it.
    guesses : bool
        Whether to write boxes of targets that are believed occluded or lost, too.

    Raises
    ------
    foveate.InputError
        The format is none of these, or cannot hold these boxes.
    foveate.FileError
        The file cannot be written.

    Notes
    -----
    A result is target 1; its confidence is 1 - P(lost), that of targets is 1 - deficit, 0 at least. What a format does not hold is
    logged (level INFO of the logger ``"foveate"``).
    """
    rows: list[tuple[int, int, Box, float]] = []
    count = 0
    for at, seen in enumerate(results):
        count += 1
        if isinstance(seen, Result):
            if seen.ok or guesses:
                rows.append((at, 1, seen.box, 1 - seen.p_lost))
            continue
        for (target, box), ok, deficit in zip(seen, seen.ok, seen.deficit.tolist()):
            if ok or guesses:
                rows.append((at, target, box, max(0.0, 1 - deficit)))
    for note in export_boxes(format, path, rows, count, size):
        LOG.info("%s: %s", os.fspath(path), note)
