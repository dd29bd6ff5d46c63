"""What docstrings, documents and examples show is run; the stubs are what the module has."""

from __future__ import annotations

import doctest
import importlib
import importlib.util
import inspect
import os
import pkgutil
import re
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIRST, ROOT

import foveate


def modules() -> list[types.ModuleType]:
    """All but the program, and what needs a package that is not there."""
    without = {"__main__"} if importlib.util.find_spec("sklearn") else {"__main__", "learn"}
    names = [m.name for m in pkgutil.iter_modules(foveate.__path__) if m.name not in without]
    return [foveate, *(importlib.import_module(f"foveate.{name}") for name in names)]


def documented() -> dict[str, Any]:
    """Everything that has a docstring, by name: the classes of the extension too, which doctest itself does not find."""
    found: dict[str, Any] = {}
    for module in modules():
        found[module.__name__] = module
        for name, value in vars(module).items():
            if not getattr(value, "__module__", "").startswith("foveate"):
                continue
            found[f"{value.__module__}.{name}"] = value
            if inspect.isclass(value):
                members = ((n, v) for n, v in vars(value).items() if not n.startswith("_"))
                found.update({f"{value.__module__}.{name}.{n}": v for n, v in members})
    return found


def test_docstrings_are_true() -> None:
    runner, ran = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE), 0
    for name, value in documented().items():
        text = value.__doc__
        if isinstance(text, str) and ">>>" in text:
            home = sys.modules.get(getattr(value, "__module__", None) or name, foveate)
            test = doctest.DocTestParser().get_doctest(text, {**vars(home), "foveate": foveate}, name, name, 0)
            ran += runner.run(test).attempted
    assert ran >= 15 and runner.summarize(verbose=False).failed == 0


def test_everything_public_has_a_docstring() -> None:
    for name in foveate.__all__:
        value = getattr(foveate, name)
        if name == "__version__":
            continue
        assert value.__doc__, name
        if inspect.isclass(value) and value.__module__ == "foveate":
            for member, v in vars(value).items():
                assert member.startswith("_") or v.__doc__, f"{name}.{member}"


def check(*arguments: str) -> None:
    done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, cwd=ROOT, env=environment())
    assert done.returncode == 0, done.stdout + done.stderr


def environment() -> dict[str, str]:
    """Where the package is not installed, the one under test."""
    place = str(Path(foveate.__file__).parents[1])
    return dict(os.environ) if "site-packages" in place else {**os.environ, "PYTHONPATH": place, "MYPYPATH": place}


def test_mypy_accepts_the_examples() -> None:
    pytest.importorskip("mypy", reason="skipped: no mypy")
    examples = sorted(str(p) for p in (ROOT / "python/examples").glob("*.py"))
    check("mypy", "--strict", "--explicit-package-bases", "--cache-dir", os.devnull, *examples)


def test_mypy_accepts_the_package() -> None:
    pytest.importorskip("mypy", reason="skipped: no mypy")
    check("mypy", "--strict", "--cache-dir", os.devnull, str(ROOT / "python/foveate"))


def test_the_stubs_are_what_the_module_has() -> None:
    pytest.importorskip("mypy", reason="skipped: no mypy")
    check("mypy.stubtest", "foveate._foveate", "--ignore-missing-stub", "--ignore-disjoint-bases")


@pytest.mark.parametrize("example", sorted((ROOT / "python/examples").glob("*.py")), ids=lambda path: path.stem)
def test_examples_run(example: Path, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, example], capture_output=True, text=True, cwd=tmp_path, env=environment())
    assert done.returncode == 0, done.stderr


class Opencv(types.ModuleType):
    """As much of OpenCV as the page "from OpenCV" calls, over drawn pictures."""

    def __init__(self, pictures: Any) -> None:
        super().__init__("cv2")
        self.pictures, self.drawn = [p[..., ::-1].copy() for p in pictures], 0

    def VideoCapture(self, _: str) -> Any:
        left = iter(self.pictures)

        def read() -> Any:
            picture = next(left, None)
            return picture is not None, picture

        return types.SimpleNamespace(read=read, isOpened=lambda: True)

    def selectROI(self, *_: Any) -> Any:
        return FIRST

    def rectangle(self, _: Any, start: Any, end: Any, *__: Any) -> None:
        assert all(isinstance(v, int) for v in (*start, *end)), "OpenCV draws whole pixels"
        self.drawn += 1

    def putText(self, *_: Any) -> None: ...

    def imshow(self, *_: Any) -> None: ...

    def waitKey(self, _: int) -> int:
        return -1

    FONT_HERSHEY_SIMPLEX = 0

    def TrackerCSRT_create(self) -> Any:
        return types.SimpleNamespace(init=lambda image, first: None, update=lambda image: (True, FIRST))


def blocks(document: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / document).read_text(), re.S)


def test_the_page_from_opencv(pictures: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both programs of the page run, and two lines are all that differs."""
    before, after, *_ = programs = blocks("from-opencv.md")
    changed = [line for line in after.splitlines() if line not in before.splitlines()]
    assert len(changed) == 2 and len(after.splitlines()) - len(before.splitlines()) == 1, changed
    for program in programs:
        cv2 = Opencv(pictures)
        monkeypatch.setitem(sys.modules, "cv2", cv2)
        exec(compile(program, "docs/from-opencv.md", "exec"), {})
        assert cv2.drawn == len(pictures) - 1


@pytest.mark.parametrize("page", ["python.md", "../README.md"])
def test_the_pages_on_python(page: str, pictures: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    video = [p.copy() for p in pictures]
    monkeypatch.setattr(foveate, "Video", lambda *_, **__: iter(video))
    shared: dict[str, Any] = {"np": np}
    for program in blocks(page):
        if "import sklearn" in program:
            pytest.importorskip("sklearn", reason="skipped: no scikit-learn")
        exec(compile(program, page, "exec"), shared)
