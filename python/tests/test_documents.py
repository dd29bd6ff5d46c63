"""What docstrings, documents and examples show is run; the stubs are what the module has."""

from __future__ import annotations

import ast
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
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIRST, ROOT
from test_program import write_png

import foveate
from foveate import _foveate


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


STUB = ROOT / "python" / "foveate" / "_foveate.pyi"


def public(tree: ast.Module) -> Iterator[tuple[ast.ClassDef | ast.FunctionDef, Any]]:
    """The classes, functions, methods and properties of the stub, and what they are in the module."""
    for top in tree.body:
        if isinstance(top, (ast.ClassDef, ast.FunctionDef)) and top.name in vars(_foveate):
            value = getattr(_foveate, top.name)
            if top.name.startswith("_"):
                continue
            yield top, value
            for inner in top.body if isinstance(top, ast.ClassDef) else []:
                if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_"):
                    yield inner, vars(value)[inner.name]


def with_docstrings(text: str) -> str:
    """The stub with the docstrings of the module: editors show those of the stub alone."""
    lines = text.splitlines()
    for node, value in reversed(list(public(ast.parse(text)))):
        first, indent = node.body[0], " " * (node.col_offset + 4)
        doc = (inspect.getdoc(value) or "").replace("\\", "\\\\").splitlines()
        shown = [f'{indent}"""{line}' if at == 0 else f"{indent}{line}" if line else "" for at, line in enumerate(doc)]
        shown = [*shown, f'{indent}"""'] if len(shown) > 1 else [f'{line}"""' for line in shown]
        old = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str)
        if not doc:
            continue
        if old:
            lines[first.lineno - 1 : first.end_lineno] = shown
        elif isinstance(node, ast.ClassDef):
            place = first.lineno - 1 - len(getattr(first, "decorator_list", []))
            lines[place:place] = shown
        else:
            assert first.lineno == first.end_lineno and lines[first.lineno - 1].endswith(": ..."), lines[first.lineno - 1]
            lines[first.lineno - 1] = lines[first.lineno - 1].removesuffix(" ...")
            lines[first.lineno : first.lineno] = shown
    return "\n".join(lines) + "\n"


def test_the_stubs_have_the_docstrings_of_the_module() -> None:
    """Editors show the stub's docstrings on hovering; FOVEATE_WRITE_DOCS=1 writes them."""
    text = STUB.read_text(encoding="utf-8")
    wanted = with_docstrings(text)
    if os.environ.get("FOVEATE_WRITE_DOCS"):
        STUB.write_text(wanted, encoding="utf-8")
    assert text == wanted or os.environ.get("FOVEATE_WRITE_DOCS"), "run this test with FOVEATE_WRITE_DOCS=1"
    bare = [node.name for node, _ in public(ast.parse(wanted)) if not ast.get_docstring(node)]
    assert not bare, f"without a docstring: {bare}"
    assert len(list(public(ast.parse(wanted)))) > 50


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

    def rectangle(self, _: Any, *corners: Any) -> None:
        """With a box, or with two corners; then a colour and a thickness."""
        whole = corners[0] if len(corners) == 3 else (*corners[0], *corners[1])
        assert len(whole) == 4 and all(type(v) is int for v in whole), "OpenCV draws whole pixels"
        self.drawn += 1

    def putText(self, *_: Any) -> None: ...

    def imshow(self, _: str, picture: Any) -> None:
        assert picture.size, "OpenCV shows no empty picture"

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
def test_the_pages_on_python(page: str, pictures: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Their video is a folder of that name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "video.mp4").mkdir()
    for t, picture in enumerate(pictures):
        write_png(tmp_path / "video.mp4" / f"{t:04}.png", picture)
    shared: dict[str, Any] = {"np": np}
    for program in blocks(page):
        if "import sklearn" in program:
            pytest.importorskip("sklearn", reason="skipped: no scikit-learn")
        exec(compile(program, page, "exec"), shared)
