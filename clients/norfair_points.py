"""Boxes of foveate as norfair's detections: a box is two points, and 1 - P(lost) its scores. norfair 2.3 needs numpy below 2."""

import norfair
import numpy as np


def detection(seen) -> norfair.Detection:
    """A `foveate.Result` as a detection."""
    x, y, w, h = seen.box
    points = np.array([[x, y], [x + w, y + h]])
    return norfair.Detection(points=points, scores=np.full(2, 1 - seen.p_lost), label="foveate")
