"""foveate as a tracker of the GOT-10k toolkit, and the toolkit's OTB experiment on any folders in OTB's layout.

    python clients/got10k_foveate.py FOLDER --out OUT     # FOLDER holds sequences: groundtruth_rect.txt, img/

Needs got10k 0.1.3 and six, which it uses without naming it.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

import foveate
import numpy as np
from got10k.experiments import ExperimentOTB
from got10k.trackers import Tracker
from otb_pictures import pictures


class FoveateTracker(Tracker):
    """The toolkit's boxes count from 1, as in its files."""

    def __init__(self, profile: str = "balanced", seed: int = 1, name: str = "foveate") -> None:
        super().__init__(name=name, is_deterministic=True)
        self.profile, self.seed = profile, seed

    def init(self, image, box) -> None:
        x, y, w, h = box
        self.tracker = foveate.Tracker(self.profile, seed=self.seed, channels="rgb")
        self.tracker.init(np.asarray(image), (x - 1, y - 1, w, h))

    def update(self, image) -> tuple[float, float, float, float]:
        x, y, w, h = self.tracker.update(np.asarray(image)).box
        return x + 1, y + 1, w, h


class Folders:
    """Sequences in OTB's layout, as the toolkit's data sets: pairs of picture files and boxes."""

    def __init__(self, root: str | Path) -> None:
        self.folders = sorted(p.parent for p in Path(root).glob("*/groundtruth_rect.txt"))
        if not self.folders:
            raise FileNotFoundError(f"{root}: expected folders with groundtruth_rect.txt and img/, found none")
        self.seq_names = [folder.name for folder in self.folders]

    def __len__(self) -> int:
        return len(self.folders)

    def __getitem__(self, i: int) -> tuple[list[str], np.ndarray]:
        text = (self.folders[i] / "groundtruth_rect.txt").read_text()
        boxes = np.array([[float(w) for w in line.replace(",", " ").split()] for line in text.splitlines() if line])
        return [str(path) for path in pictures(self.folders[i])][: len(boxes)], boxes

    def __iter__(self) -> Iterator[tuple[list[str], np.ndarray]]:
        return (self[i] for i in range(len(self)))


def experiment(root: str | Path, out: str | Path) -> ExperimentOTB:
    """The toolkit's OTB experiment on folders of yours: the toolkit's constructor has its own lists only, and downloads them."""
    made = ExperimentOTB.__new__(ExperimentOTB)
    made.dataset = Folders(root)
    made.result_dir, made.report_dir = os.path.join(out, "results"), os.path.join(out, "reports")
    made.nbins_iou, made.nbins_ce = 21, 51
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder")
    parser.add_argument("--out", default="out-got10k")
    parser.add_argument("--profile", default="balanced")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    tracker = FoveateTracker(args.profile, args.seed)
    run = experiment(args.folder, args.out)
    run.run(tracker)
    overall = run.report([tracker.name])[tracker.name]["overall"]
    print({key: overall[key] for key in ("success_score", "precision_score", "success_rate", "speed_fps")})


if __name__ == "__main__":
    main()
