"""What type checkers and editors see of the package."""

from __future__ import annotations

import functools
import importlib.util
import inspect
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_documents import environment

import foveate

MISUSE = Path(__file__).with_name("misuse.py")
WRONG = {n for n, line in enumerate(MISUSE.read_text().splitlines(), 1) if "# WRONG" in line}


def found(*command: str) -> str:
    done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, env=environment(), cwd=MISUSE.parent)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout


def test_nine_lines_are_planted() -> None:
    assert len(WRONG) == 9


def test_mypy_finds_all_that_is_wrong() -> None:
    pytest.importorskip("mypy", reason="skipped: no mypy")
    lines = found("mypy", "--strict", "--cache-dir", os.devnull, "--no-error-summary", "--follow-imports", "silent", MISUSE.name).splitlines()
    assert {int(line.split(":")[1]) for line in lines if ": error:" in line} == WRONG, lines


def need_pyright() -> None:
    """Skips without it, or where it finds and fetches no Node.js."""
    if importlib.util.find_spec("pyright") is None:
        pytest.skip("skipped: no pyright")
    if subprocess.run([sys.executable, "-m", "pyright", "--version"], capture_output=True, env=environment()).returncode:
        pytest.skip("skipped: no Node.js for pyright")


def test_pyright_finds_all_that_is_wrong() -> None:
    need_pyright()
    report = json.loads(found("pyright", "--outputjson", "--pythonpath", sys.executable, MISUSE.name))
    errors = [d for d in report["generalDiagnostics"] if d["severity"] == "error"]
    assert {d["range"]["start"]["line"] + 1 for d in errors} == WRONG, errors


class Server:
    """Pyright as editors start it, by messages on its standard streams."""

    def __init__(self, root: Path) -> None:
        command = [sys.executable, "-m", "pyright.langserver", "--stdio"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment(), cwd=root)
        self.asked = 0

    def send(self, **message: Any) -> None:
        assert self.process.stdin
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))
        self.process.stdin.flush()

    def read(self) -> Any:
        assert self.process.stdout
        size = 0
        while line := self.process.stdout.readline().strip():
            if line.lower().startswith(b"content-length:"):
                size = int(line.split(b":")[1])
        assert size, "it ended"
        return json.loads(self.process.stdout.read(size))

    def ask(self, method: str, params: Any) -> Any:
        """Answers; what it asks meanwhile gets the empty answer."""
        self.asked += 1
        self.send(id=self.asked, method=method, params=params)
        while True:
            message = self.read()
            if "method" in message and "id" in message:
                items = message["params"].get("items", []) if isinstance(message.get("params"), dict) else []
                self.send(id=message["id"], result=[{"pythonPath": sys.executable} for _ in items] or None)
            elif message.get("id") == self.asked and "method" not in message:
                return message.get("result")


def public_names() -> Iterator[str]:
    for name in foveate.__all__:
        value = getattr(foveate, name)
        if name == "__version__":
            continue
        yield name
        own = vars(value) if isinstance(value, type) else {}
        yield from (f"{name}.{member}" for member in own if not member.startswith("_"))


def first_words(name: str) -> str:
    """How the docstring begins, up to its first sign that editors set in another way."""
    doc = inspect.getdoc(functools.reduce(getattr, name.split("."), foveate)) or "nothing is said"
    return "" if doc.startswith("Alias for field") else re.split(r"[`:*_]", doc.split("\n")[0])[0].strip()


def test_editors_show_a_docstring_for_every_public_name(tmp_path: Path) -> None:
    need_pyright()
    names = list(public_names())
    text = "".join(f"foveate.{name}\n" for name in ["__doc__", *names]).replace("foveate.__doc__", "import foveate", 1)
    server, uri = Server(tmp_path), (tmp_path / "names.py").as_uri()
    try:
        folders = [{"uri": tmp_path.as_uri(), "name": "names"}]
        able = {"workspace": {"configuration": True}, "textDocument": {"hover": {"contentFormat": ["plaintext"]}}}
        server.ask("initialize", {"processId": None, "rootUri": folders[0]["uri"], "workspaceFolders": folders, "capabilities": able})
        server.send(method="initialized", params={})
        document = {"uri": uri, "languageId": "python", "version": 1, "text": text}
        server.send(method="textDocument/didOpen", params={"textDocument": document})
        bare = []
        for line, name in enumerate(names, 1):
            place = {"line": line, "character": len("foveate." + name) - 1}
            shown = server.ask("textDocument/hover", {"textDocument": {"uri": uri}, "position": place})
            value = shown["contents"]["value"] if shown else ""
            if first_words(name) not in " ".join(value.split()):
                bare.append((name, value))
        assert len(names) > 80 and not bare, bare
    finally:
        server.process.kill()
        server.process.communicate()
