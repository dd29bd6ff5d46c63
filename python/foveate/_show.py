"""Results and runs as pictures, for notebooks: HTML with SVG in it, made of the standard library and NumPy."""

from __future__ import annotations

import base64
import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._export import Format, export
from ._foveate import Tracker, Video
from ._multi import Targets
from ._result import Result
from ._types import State, counted

if TYPE_CHECKING:
    from pandas import DataFrame

_Pixels = npt.NDArray[np.uint8]

# The colours of the report: box, particles, gaze; legible on light and dark.
_BOX, _DOT, _GAZE, _LOST = "#1f77d4", "#e07b00", "#c2255c", "#c92a2a"
_STYLE = "font:13px system-ui,sans-serif"


def _png(image: _Pixels) -> str:
    """A picture (h, w) or (h, w, 3) as the text of an address."""
    height, width = image.shape[:2]
    kind = 0 if image.ndim == 2 else 2
    rows = np.ascontiguousarray(image).reshape(height, -1)
    data = np.hstack([np.zeros((height, 1), np.uint8), rows]).tobytes()

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    file = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(data, 6)) + chunk(b"IEND", b"")
    return "data:image/png;base64," + base64.b64encode(file).decode()


def _marks(result: Result, unit: float) -> str:
    """Box, particles, 90 % region and gaze, in pixels of the picture; `unit`: pixels of a stroke."""
    box, region = result.box, result.region(0.9)
    weights, particles = result.weights, result.particles
    heavy = np.argsort(weights)[::-1][:150]
    most = float(weights[heavy[0]]) if len(heavy) else 1.0
    dots = "".join(
        f'<circle cx="{particles[i, 0] + 0.5:.1f}" cy="{particles[i, 1] + 0.5:.1f}" r="{1.2 * unit:.2f}" fill="{_DOT}"'
        f' fill-opacity="{max(0.15, float(weights[i]) / most):.2f}"/>'
        for i in heavy
    )
    (u, v), colour = result.gaze, _BOX if result.ok else _LOST
    at, arm = (box.x + 0.5 * box.w * (1 + u), box.y + 0.5 * box.h * (1 + v)), 4 * unit
    # A pixel's middle has whole coordinates, the picture begins half a pixel before.
    x, y = region.x + 0.5, region.y + 0.5
    return (
        f'{dots}<rect x="{box.x:.1f}" y="{box.y:.1f}" width="{box.w:.1f}" height="{box.h:.1f}" fill="none" stroke="{colour}"'
        f' stroke-width="{2 * unit:.2f}"/>'
        f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="{region.major:.1f}" ry="{region.minor:.1f}" fill="none"'
        f' stroke="{colour}" stroke-dasharray="{4 * unit:.1f}" stroke-width="{unit:.2f}"'
        f' transform="rotate({np.degrees(region.angle):.1f} {x:.1f} {y:.1f})"/>'
        f'<path d="M{at[0] - arm:.1f} {at[1]:.1f}h{2 * arm:.1f}M{at[0]:.1f} {at[1] - arm:.1f}v{2 * arm:.1f}" stroke="{_GAZE}"'
        f' stroke-width="{1.5 * unit:.2f}"/>'
    )


def _words(result: Result) -> str:
    box = result.box
    return (
        f"{escape(result.status)}, P(lost) {result.p_lost:.2f}; box {box.x:.0f}, {box.y:.0f}, {box.w:.0f} × {box.h:.0f};"
        f" effective sample size {result.ess:.0f}"
    )


def result_html(result: Result) -> str:
    """A result without its picture: what `Result` shows in a notebook."""
    box = result.box
    side = 2.5 * max(box.w, box.h, 1.0)
    left, top = box.x + 0.5 * (box.w - side), box.y + 0.5 * (box.h - side)
    return (
        f'<div style="{_STYLE}"><svg width="220" height="220" viewBox="{left:.1f} {top:.1f} {side:.1f} {side:.1f}" role="img"'
        f' aria-label="box, particles, region and gaze">{_marks(result, side / 220)}</svg><br>{_words(result)}</div>'
    )


def targets_html(targets: Targets) -> str:
    """Targets without their picture: what `Targets` shows in a notebook."""
    if not len(targets):
        return f'<div style="{_STYLE}">no targets</div>'
    corners = targets.xyxy
    (left, top), (right, bottom) = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    width, height = max(right - left, 1.0), max(bottom - top, 1.0)
    pad = 0.05 * max(width, height)
    shown = min(480.0, 320.0 * (width + 2 * pad) / (height + 2 * pad))
    unit = (width + 2 * pad) / shown
    rows, boxes = [], []
    for (target, box), ok, phase, deficit in zip(targets, targets.ok, targets.phases, targets.deficit.tolist()):
        colour = _BOX if ok else _LOST
        boxes.append(
            f'<rect x="{box.x:.1f}" y="{box.y:.1f}" width="{box.w:.1f}" height="{box.h:.1f}" fill="none" stroke="{colour}"'
            f' stroke-width="{2 * unit:.2f}"/><text x="{box.x + 3 * unit:.1f}" y="{box.y + 14 * unit:.1f}" fill="{colour}"'
            f' font-size="{12 * unit:.1f}">{target}</text>'
        )
        cells = (target, escape(phase), f"{box.x:.0f}, {box.y:.0f}, {box.w:.0f} × {box.h:.0f}", f"{deficit:.2f}")
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    head = "".join(f"<th>{name}</th>" for name in ("id", "phase", "box", "deficit"))
    return (
        f'<div style="{_STYLE}"><svg width="{shown:.0f}" height="{(height + 2 * pad) / unit:.0f}" role="img" aria-label="boxes and ids"'
        f' viewBox="{left - pad:.1f} {top - pad:.1f} {width + 2 * pad:.1f} {height + 2 * pad:.1f}">{"".join(boxes)}</svg>'
        f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


class Run:
    """A tracker's results over a video, kept to look at: in a notebook it shows pictures of the run and P(lost) over time.

    >>> import numpy as np, foveate
    >>> def picture(t):
    ...     image = np.random.default_rng(1).integers(0, 60, (90, 120)).astype(np.uint8)
    ...     image[30:54, 20 + 2 * t : 44 + 2 * t] = np.random.default_rng(2).integers(100, 256, (24, 24))
    ...     return image
    >>> run = foveate.Run.of(foveate.Tracker("fast", channels="grey"), map(picture, range(8)), (20, 30, 24, 24))
    >>> len(run), run.boxes.shape, run.p_lost.shape
    (8, (8, 4), (8,))

    It is as long as the video: the first result is the box that was given. Every result is kept (about 40 kB each with 800
    particles), and some of the pictures, made smaller.
    """

    def __init__(self, channels: str = "rgb") -> None:
        """An empty run; `channels` is the order of the bytes of colour pictures, as the tracker has it."""
        self.results: list[Result] = []
        """One for each picture."""
        self.size: tuple[int, int] | None = None
        """Width and height of the pictures; None before the first one."""
        self._channels = channels
        self._every = 1
        self._pictures: dict[int, tuple[int, _Pixels]] = {}

    @classmethod
    def of(
        cls,
        tracker: Tracker,
        video: Video | str | os.PathLike[str] | int | Iterable[Any],
        box: Sequence[float],
        *,
        progress: bool | None = None,
    ) -> Run:
        """Follows a target whose box is given in the first picture, as :meth:`Tracker.track` does."""
        run = cls(tracker.channels)
        for seen in tracker.track(video, box, progress=progress):
            run.add(seen.image, seen)
        return run

    def add(self, image: Any, result: Result) -> None:
        """Keeps a result; the picture is kept where its turn is."""
        at = len(self.results)
        self.results.append(result)
        if self.size is None:
            height, width = np.shape(image)[:2]
            self.size = width, height
        if at % self._every == 0:
            pixels = np.asarray(image)
            step = max(1, max(pixels.shape[:2]) // 240)
            self._pictures[at] = step, self._rgb(pixels[::step, ::step]).copy()
            if len(self._pictures) > 16:
                self._every *= 2
                self._pictures = {at: kept for at, kept in self._pictures.items() if at % self._every == 0}

    def _rgb(self, pixels: _Pixels) -> _Pixels:
        if pixels.ndim == 2 or pixels.shape[2] == 1:
            return pixels.reshape(pixels.shape[:2])
        colours = pixels[..., :3]
        return colours[..., ::-1] if self._channels.startswith("bgr") else colours

    def __len__(self) -> int:
        return len(self.results)

    def __getitem__(self, at: int) -> Result:
        return self.results[at]

    def __iter__(self) -> Iterator[Result]:
        return iter(self.results)

    @property
    def boxes(self) -> npt.NDArray[np.float64]:
        """The boxes; float64, shape (n, 4): left, top, width, height."""
        return np.array([r.box for r in self.results], dtype=np.float64).reshape(-1, 4)

    @property
    def p_lost(self) -> npt.NDArray[np.float64]:
        """P(lost) over time; float64, shape (n,)."""
        return np.array([r.p_lost for r in self.results], dtype=np.float64)

    def to_dataframe(self) -> DataFrame:
        """A pandas DataFrame with a row for each picture.

        Columns: frame (from 0), time (s), left, top, width, height (pixels from 0), ok, status, p_lost, x, y, vx, vy, log_scale,
        angle, log_aspect (the state), sd_x, sd_y (standard deviations of the centre, pixels), ess.

        Raises
        ------
        ImportError
            The package pandas is not installed.
        """
        try:
            import pandas  # noqa: PLC0415: optional
        except ImportError as error:
            raise ImportError("to_dataframe() needs the package pandas: pip install pandas") from error
        columns: dict[str, Any] = {
            "frame": [at if r.frame is None else r.frame for at, r in enumerate(self.results)],
            "time": np.array([np.nan if r.time is None else r.time for r in self.results], dtype=np.float64),
        }
        columns |= dict(zip(("left", "top", "width", "height"), self.boxes.T))
        columns |= {"ok": [r.ok for r in self.results], "status": [r.status for r in self.results], "p_lost": self.p_lost}
        columns |= dict(zip(State._fields, np.array([r.state for r in self.results], dtype=np.float64).reshape(-1, len(State._fields)).T))
        deviations = np.sqrt([np.diag(r.covariance)[:2] for r in self.results]).reshape(-1, 2)
        columns |= {"sd_x": deviations[:, 0], "sd_y": deviations[:, 1], "ess": [r.ess for r in self.results]}
        return pandas.DataFrame(columns)

    def export(self, path: str | os.PathLike[str], format: Format, *, guesses: bool = False) -> None:
        """Writes the boxes to a file of another program, as :func:`foveate.export` does: ``run.export("run.json", "coco")``."""
        export(self.results, path, format, size=self.size, guesses=guesses)

    def errors(self, truth: Sequence[Sequence[float]]) -> npt.NDArray[np.float64]:
        """Distance of the box's centre from that of the true box, pixels; shape (n,). `truth` has a box for each result."""
        true = np.asarray(truth, dtype=np.float64).reshape(-1, 4)
        if len(true) != len(self):
            raise ValueError(f"expected a true box for each of {counted(len(self), 'result')}, found {len(true)}")
        off = (self.boxes[:, :2] + self.boxes[:, 2:] / 2) - (true[:, :2] + true[:, 2:] / 2)
        return np.asarray(np.hypot(off[:, 0], off[:, 1]), dtype=np.float64)

    def __repr__(self) -> str:
        lost = sum(not r.ok for r in self.results)
        return f"<Run of {counted(len(self), 'result')}, occluded or lost in {lost}>"

    def _repr_html_(self) -> str:
        kept = list(self._pictures.items())
        shown = kept[:: max(1, -(-len(kept) // 4))]
        figures = "".join(self._figure(at, step, pixels) for at, (step, pixels) in shown)
        return f'<div style="{_STYLE}">{escape(repr(self))}<br>{figures}{self._curve()}</div>'

    def _figure(self, at: int, step: int, pixels: _Pixels) -> str:
        height, width = pixels.shape[0] * step, pixels.shape[1] * step
        shown = min(240.0, float(width))
        return (
            f'<figure style="display:inline-block;vertical-align:top;margin:4px;width:{shown:.0f}px"><svg width="{shown:.0f}" height="{shown * height / width:.0f}"'
            f' viewBox="0 0 {width} {height}" role="img" aria-label="picture {at + 1}">'
            f'<image width="{width}" height="{height}" href="{_png(pixels)}"/>{_marks(self.results[at], width / shown)}</svg>'
            f"<figcaption>picture {at + 1}: {_words(self.results[at])}</figcaption></figure>"
        )

    def _curve(self) -> str:
        n, (width, height) = max(len(self) - 1, 1), (720, 90)
        points = " ".join(f"{40 + (width - 50) * t / n:.1f},{10 + height * (1 - p):.1f}" for t, p in enumerate(self.p_lost))
        ticks = "".join(
            f'<line x1="40" x2="{width - 10}" y1="{10 + height * (1 - p):.0f}" y2="{10 + height * (1 - p):.0f}" stroke="#8884"/>'
            f'<text x="34" y="{14 + height * (1 - p):.0f}" text-anchor="end" fill="currentColor" font-size="11">{p:g}</text>'
            for p in (0.0, 0.5, 1.0)
        )
        return (
            f'<br><svg width="{width}" height="{height + 40}" role="img" aria-label="P(lost) over time">{ticks}'
            f'<polyline points="{points}" fill="none" stroke="{_LOST}" stroke-width="1.5"/>'
            f'<text x="40" y="{height + 28}" fill="currentColor" font-size="11">P(lost), pictures 1 to {len(self)}</text></svg>'
        )

