"""Many targets with supervision: detections of yours in, `Detections` with `tracker_id` out, drawn on the picture."""

import foveate
import numpy as np
import supervision as sv


def follow(images, detections) -> list[sv.Detections]:
    """Tracks through pictures, given each picture's `supervision.Detections`; classes and data are carried through, guesses left out."""
    tracker = foveate.MultiTracker("multi")
    return [tracker.update(image, found).to_supervision() for image, found in zip(images, detections)]


def draw(image: np.ndarray, tracks: sv.Detections) -> np.ndarray:
    classes = tracks.data.get("class_name", [""] * len(tracks))
    names = [f"{target} {name}".strip() for target, name in zip(tracks.tracker_id, classes)]
    drawn = sv.BoxAnnotator().annotate(image.copy(), tracks)
    return sv.LabelAnnotator().annotate(drawn, tracks, labels=names)
