"""Results and runs show themselves, and the notebooks run."""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import xml.etree.ElementTree as tree
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from conftest import FIRST, ROOT, drawn

import foveate
from foveate import _show

NOTEBOOKS = sorted((ROOT / "python" / "notebooks").glob("*.ipynb"))


def parsed(html: str) -> tree.Element:
    """It is well-formed, and holds nothing from elsewhere."""
    assert "http" not in html and "<script" not in html
    return tree.fromstring(html.replace("<br>", "<br/>"))


def test_a_result_shows_box_particles_region_and_gaze(pictures: list[npt.NDArray[np.uint8]]) -> None:
    tracker = foveate.Tracker("fast")
    tracker.init(pictures[0], FIRST)
    seen = tracker.update(pictures[1])
    shown = parsed(seen._repr_html_())
    (box,), circles = shown.findall(".//rect"), shown.findall(".//circle")
    assert float(box.attrib["x"]) == pytest.approx(seen.box.x, abs=0.06) and 20 <= len(circles) <= 150
    # The middle of the ellipse is that of the box where the estimate is the box's.
    ellipse = shown.find(".//ellipse")
    assert ellipse is not None and float(ellipse.attrib["cx"]) == pytest.approx(seen.region().x + 0.5, abs=0.06)
    assert len(shown.findall(".//ellipse")) == 1 and len(shown.findall(".//path")) == 1


@pytest.mark.parametrize("channels", ["rgb", "bgr"])
def test_a_run_shows_pictures_and_the_curve(channels: Any) -> None:
    frames = [drawn(t)[..., :: -1 if channels == "bgr" else 1] for t in range(32)]
    run = foveate.Run.of(foveate.Tracker("fast", channels=channels), frames, FIRST)
    assert len(run) == 32 and run[3] is run.results[3] and "32 results" in repr(run)
    shown = parsed(run._repr_html_())
    images, (curve,) = shown.findall(".//image"), shown.findall(".//polyline")
    assert 2 <= len(images) <= 4 and len(curve.attrib["points"].split()) == 32
    # The first picture kept is the first of the video, its colours red, green, blue whatever the tracker's order.
    file = base64.b64decode(images[0].attrib["href"].split(",")[1])
    at = file.index(b"IDAT")
    size = int.from_bytes(file[at - 4 : at], "big")
    rows = np.frombuffer(zlib.decompress(file[at + 4 : at + 4 + size]), np.uint8).reshape(120, 1 + 160 * 3)
    np.testing.assert_array_equal(rows[:, 1:].reshape(120, 160, 3), drawn(0))
    errors = run.errors([(40 + 3 * t, 30 + t, 24, 24) for t in range(32)])
    assert errors.shape == (32,) and errors[:20].max() < 4
    with pytest.raises(ValueError, match="each of 32 results, found 1"):
        run.errors([FIRST])


def test_a_grey_picture_may_have_an_axis_of_its_own() -> None:
    frames = [drawn(t)[..., 0] for t in range(4)]
    flat, deep = (
        foveate.Run.of(foveate.Tracker("fast", channels="grey"), given, FIRST)._repr_html_()
        for given in (frames, [frame[..., None] for frame in frames])
    )
    assert flat == deep and "data:image/png" in flat


def test_targets_show_boxes_and_a_table(pictures: list[npt.NDArray[np.uint8]]) -> None:
    tracker = foveate.MultiTracker(config={"particles": 60})
    parsed(tracker.targets._repr_html_())
    for t, picture in enumerate(pictures[:6]):
        targets = tracker.update(picture, [(40 + 3 * t, 30 + t, 24, 24, 0.9), (100, 80 - t, 20, 20, 0.8)])
    shown = parsed(targets._repr_html_())
    assert len(targets) == 2 == len(shown.findall(".//rect")) == len(shown.findall(".//tbody/tr"))
    assert [text.text for text in shown.findall(".//text")] == [str(k) for k in targets.ids]
    for rect, box in zip(shown.findall(".//rect"), targets.boxes):
        assert [float(rect.attrib[k]) for k in ("x", "y", "width", "height")] == pytest.approx(box.tolist(), abs=0.06)


def test_an_empty_run_shows_itself() -> None:
    run = foveate.Run()
    assert run.boxes.shape == (0, 4) and run.p_lost.shape == (0,)
    parsed(run._repr_html_())


def test_pictures_of_a_long_run_stay_few(pictures: list[npt.NDArray[np.uint8]]) -> None:
    tracker = foveate.Tracker("fast")
    tracker.init(pictures[0], FIRST)
    seen, run = tracker.update(pictures[1]), foveate.Run()
    for _ in range(500):
        run.add(np.zeros((1000, 2000, 3), np.uint8), seen)
    assert len(run._pictures) <= 16 and all(p.shape[1] <= 250 for _, p in run._pictures.values())


def ran(source: str, names: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Runs a cell; its outputs as a notebook keeps them: what it prints, and what it ends with."""
    body, value, printed = ast.parse(source), None, io.StringIO()
    last = ast.Expression(body.body.pop().value) if isinstance(body.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(printed):
        exec(compile(body, "cell", "exec"), names)
        if last is not None:
            value = eval(compile(last, "cell", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if text := printed.getvalue():
        outputs.append({"name": "stdout", "output_type": "stream", "text": text.splitlines(keepends=True)})
    if value is not None:
        data = {"text/plain": [repr(value)]}
        if hasattr(value, "_repr_html_"):
            data["text/html"] = [value._repr_html_()]
        outputs.append({"data": data, "execution_count": count, "metadata": {}, "output_type": "execute_result"})
    return outputs


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_has_what_its_code_gives(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Anew after a change of results: ``FOVEATE_WRITE_DOCS=1 pytest python/tests/test_show.py``."""
    monkeypatch.syspath_prepend(str(path.parent))
    notebook = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    names: dict[str, Any] = {}
    made = [ran("".join(cell["source"]), names, i + 1) for i, cell in enumerate(code)]
    if os.environ.get("FOVEATE_WRITE_DOCS"):
        for i, (cell, outputs) in enumerate(zip(code, made)):
            cell.update(execution_count=i + 1, outputs=outputs)
        path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    # A picture comes first, and all of them are small.
    lines = [len(cell["source"]) for cell in code]
    first = next(i for i, outputs in enumerate(made) if any("text/html" in output.get("data", {}) for output in outputs))
    assert sum(lines[: first + 1]) <= 10 and max(lines) <= 16, lines
    assert path.stat().st_size < 250_000
    for cell, outputs in zip(code, made):
        kept, new = (["".join(o.get("text", [])) for o in given] for given in (cell["outputs"], outputs))
        assert kept == new
        for output in cell["outputs"]:
            if html := output.get("data", {}).get("text/html"):
                parsed("".join(html))


def test_there_are_three_notebooks() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["detector", "track", "where_to_look"]
    assert _show.__doc__
