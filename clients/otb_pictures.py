"""The pictures of a sequence in OTB's layout, for got10k_foveate.py and vot_workspace.py."""

import re
from pathlib import Path


def pictures(sequence: Path) -> list[Path]:
    """The files of `img/` in the order of the numbers in their names, 2 before 10, as foveate takes them."""

    def order(path: Path) -> tuple[list[str | int], str]:
        parts = re.split("([0-9]+)", path.name)
        return [int(part) if i % 2 else part for i, part in enumerate(parts)], path.name

    return sorted((sequence / "img").iterdir(), key=order)
