"""Folders, and addresses that the package fsspec supports, such as ``s3://bucket/runs``: where videos come from and results go to."""

from __future__ import annotations

import contextlib
import glob
import importlib
import os
import posixpath
import tempfile
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from .errors import FileError


def is_address(place: str) -> bool:
    """Whether this is none of this machine's paths."""
    return "://" in place


def absolute(place: str) -> str:
    """A place that means the same wherever it is read."""
    kind, mark, path = place.partition("://")
    return f"{kind}{mark}{path.rstrip('/')}" if mark else os.path.abspath(place)


@contextlib.contextmanager
def _reached(address: str) -> Iterator[tuple[Any, str]]:
    """The file system of an address, and its path there; what goes wrong with it is a FileError."""
    try:
        fsspec: Any = importlib.import_module("fsspec")
        files, path = fsspec.url_to_fs(address)
    except (ImportError, ValueError) as error:
        needs = "needs the package fsspec, and one for this kind of address, such as s3fs"
        raise FileError(f"{address} {needs}: {error}") from None
    try:
        # The folder may have changed since it was listed.
        files.invalidate_cache()
        yield files, path
    except Exception as error:
        raise FileError(f"{address}: {type(error).__name__}: {error}") from error


def matching(pattern: str) -> list[str]:
    """What a pattern names; in an address as addresses."""
    if not is_address(pattern):
        return glob.glob(pattern)
    with _reached(pattern) as (files, path):
        return [files.unstrip_protocol(found) for found in files.glob(path)]


def fetch(video: str, folder: str) -> str:
    """Copies a video, and the file of its first box, if there is one, to a folder; answers the copy."""
    with _reached(video) as (files, path):
        first = f"{path.rsplit('.', 1)[0]}.txt"
        for name in (path, first):
            if name == path or files.exists(name):
                files.get_file(name, os.path.join(folder, posixpath.basename(name)))
        return os.path.join(folder, posixpath.basename(path))


def names(place: str, ending: str) -> set[str]:
    """The names, without the ending, of a folder's files that have it; none where there is no folder."""
    if not is_address(place):
        return {path.name.removesuffix(ending) for path in Path(place).glob(f"*{ending}")}
    with _reached(place) as (files, root):
        try:
            found = files.ls(root, detail=False)
        except FileNotFoundError:
            return set()
        return {posixpath.basename(path).removesuffix(ending) for path in found if path.endswith(ending)}


def texts(place: str, names: Collection[str]) -> list[str]:
    """The texts of files of a folder."""
    if not is_address(place):
        return [Path(place, name).read_text() for name in names]
    with _reached(place) as (files, root):
        paths = [f"{root}/{name}" for name in names]
        found = files.cat(paths) if paths else {}
        return [found[path].decode() for path in paths]


def write(place: str, text: str) -> None:
    """Writes a file that is whole or not there."""
    folder, name = place.rsplit("/", 1)
    part = f".{name}.{os.getpid()}"
    if not is_address(place):
        Path(folder, part).write_text(text)
        os.replace(Path(folder, part), place)
        return
    with _reached(folder) as (files, root):
        files.makedirs(root, exist_ok=True)
        # Not every system has files that appear whole.
        files.pipe_file(f"{root}/{part}", text.encode())
        files.mv(f"{root}/{part}", f"{root}/{name}")


def remove(place: str) -> None:
    """Removes a file, if it is there."""
    if not is_address(place):
        Path(place).unlink(missing_ok=True)
        return
    with _reached(place) as (files, path):
        if files.exists(path):
            files.rm_file(path)


def _stamps(folder: str) -> dict[str, tuple[int, int]]:
    """When the files of a folder were written, and their sizes, by their names in it."""
    stamps = ((path, path.stat()) for path in sorted(Path(folder).rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): (stat.st_mtime_ns, stat.st_size) for path, stat in stamps}


def _upload(folder: str, address: str, before: Mapping[str, tuple[int, int]]) -> None:
    """Copies the files of a folder that are not as before."""
    changed = [name for name, stamp in _stamps(folder).items() if before.get(name) != stamp]
    with _reached(address) as (files, root):
        for inner in sorted({posixpath.dirname(f"{root}/{name}") for name in changed}):
            files.makedirs(inner, exist_ok=True)
        for name in changed:
            files.put_file(os.path.join(folder, name), f"{root}/{name}")


def upload(folder: str, address: str) -> None:
    """Copies a folder's files; what else was there, from a call that was killed, goes."""
    _upload(folder, address, {})
    with _reached(address) as (files, root):
        for stale in set(files.find(root)) - {f"{root}/{name}" for name in _stamps(folder)}:
            files.rm_file(stale)


@contextlib.contextmanager
def nearby(place: str) -> Iterator[str]:
    """A folder with the files of an address; those that are new or changed at the end are copied back. A folder is itself."""
    if not is_address(place):
        yield place
        return
    with tempfile.TemporaryDirectory() as folder:
        with _reached(place) as (files, root):
            for path in files.find(root):
                copy = Path(folder, posixpath.relpath(path, root))
                copy.parent.mkdir(parents=True, exist_ok=True)
                files.get_file(path, str(copy))
        before = _stamps(folder)
        try:
            yield folder
        finally:
            _upload(folder, place, before)
