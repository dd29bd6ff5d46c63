"""Results drawn on pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._foveate import draw_marks
from ._multi import Targets
from ._result import Result

if TYPE_CHECKING:
    from ._foveate import _Box, _Channels, _Image

_Floats = npt.NDArray[np.float64]
_Colour = tuple[int, int, int]

_TARGET: _Colour = (57, 182, 255)
_GUESS: _Colour = (255, 122, 56)
# Colours that also the colour-blind can distinguish (Okabe and Ito).
_IDS: tuple[_Colour, ...] = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (240, 228, 66), (0, 114, 178), (213, 94, 0), (204, 121, 167))


def draw(
    image: _Image,
    seen: Result | Targets,
    *,
    trail: Iterable[Result | Targets | _Box] = (),
    particles: bool = True,
    id: int | str | None = None,
    channels: _Channels | None = None,
) -> npt.NDArray[np.uint8]:
    """A copy of a picture with the result drawn: box, particles, trail and id.

    Parameters
    ----------
    image : uint8 array, (height, width) or (height, width, channels)
        The picture; it is not changed.
    seen : Result or Targets
        The tracker's result for it. Boxes that are guesses have another colour.
    trail : results, targets or boxes, optional
        Those of earlier pictures, in order: a line through their centres.
    particles : bool
        Whether to draw the particles of a result, the lighter the heavier.
    id : int or str, optional
        A text above the box of a result; targets have their ids.
    channels : str, optional
        The order of the picture's bytes. Left out: the result's, and ``"rgb"`` with targets.

    Returns
    -------
    uint8 array, (height, width, 3)
        In the order of the channels, without alpha.

    Examples
    --------
    >>> import numpy as np, foveate
    >>> image = np.zeros((120, 160, 3), np.uint8)
    >>> seen = foveate.Tracker("fast").init(image, (40, 30, 24, 24))
    >>> foveate.draw(image, seen, id=1).shape
    (120, 160, 3)
    """
    order = channels or (seen.channels if isinstance(seen, Result) else "rgb")
    discs = np.empty((0, 3))
    if isinstance(seen, Result):
        boxes, colours = np.array([seen.box]), [_TARGET if seen.ok else _GUESS]
        texts = ["" if id is None else str(id)]
        if particles and len(seen.weights):
            share = np.sqrt(seen.weights / seen.weights.max())
            discs = np.column_stack([seen.particles[:, :2], share])[np.argsort(share)]
        paths = [(_centres(trail, seen.box), colours[0])]
    else:
        ids = seen.ids.tolist()
        boxes, colours, texts = seen.boxes, [_IDS[k % len(_IDS)] for k in ids], [str(k) for k in ids]
        colours = [colour if ok else _GUESS for colour, ok in zip(colours, seen.ok)]
        earlier = [dict(targets) for targets in trail if isinstance(targets, Targets)]
        paths = [
            (_centres([targets[k] for targets in earlier if k in targets], box), colour)
            for (k, box), colour in zip(seen, colours)
        ]
    rows = np.ascontiguousarray(boxes, dtype=np.float64).reshape(-1, 4)
    return draw_marks(image, order, rows, colours, texts, np.ascontiguousarray(discs), [p for p in paths if len(p[0]) > 1])


def _centres(trail: Iterable[Any], last: Sequence[float]) -> _Floats:
    """The centres of boxes; the centre of the top-left pixel is (0, 0)."""
    boxes = [one.box if isinstance(one, Result) else one for one in trail]
    rows = np.array([*boxes, last], dtype=np.float64).reshape(-1, 4)
    return rows[:, :2] + rows[:, 2:] / 2 - 0.5
