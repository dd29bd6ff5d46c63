"""The figures of TrackEval for tracks in MOTChallenge's text.

    python clients/trackeval_figures.py gt.txt tracks.txt

Only its metrics are called: its own reader of MOTChallenge expects folders of a whole benchmark, and leaves out classes.
"""

import sys
from typing import Any

import numpy as np
from mot_text import overlaps, rows
from trackeval.metrics import CLEAR, HOTA, Identity


def figures(truth: str, tracks: str) -> dict[str, float]:
    """HOTA, DetA and AssA (means over its 19 thresholds), MOTA, IDF1 and the number of identity switches."""
    true, found = rows(truth, truth=True), rows(tracks)
    frames = np.unique(np.concatenate([true[:, 0], found[:, 0]]))
    names = [np.unique(table[:, 1]) for table in (true, found)]
    data: dict[str, Any] = {"gt_ids": [], "tracker_ids": [], "similarity_scores": [], "num_timesteps": len(frames)}
    for frame in frames:
        a, b = (table[table[:, 0] == frame] for table in (true, found))
        data["gt_ids"].append(np.searchsorted(names[0], a[:, 1]))
        data["tracker_ids"].append(np.searchsorted(names[1], b[:, 1]))
        data["similarity_scores"].append(overlaps(a[:, 2:], b[:, 2:]))
    for kind, table, ids in (("gt", true, names[0]), ("tracker", found, names[1])):
        data[f"num_{kind}_dets"], data[f"num_{kind}_ids"] = len(table), len(ids)
    quiet = {"PRINT_CONFIG": False}
    hota, clear, identity = (m.eval_sequence(data) for m in (HOTA(), CLEAR(quiet), Identity(quiet)))
    names_of = {"hota": "HOTA", "det_a": "DetA", "ass_a": "AssA"}
    answer = {name: float(np.mean(hota[theirs])) for name, theirs in names_of.items()}
    return {**answer, "mota": float(clear["MOTA"]), "idf1": float(identity["IDF1"]), "num_switches": float(clear["IDSW"])}


if __name__ == "__main__":
    print(figures(*sys.argv[1:3]))
