"""foveate as a tracking function of CVAT (cvat-sdk 2.80): rectangles through a task's frames; none where the target is lost.

    cvat-cli function create-native foveate --function-file=clients/cvat_function.py
    cvat-cli function run-agent ID --function-file=clients/cvat_function.py

The state of a target is JSON, so that it can be stored and sent. Parameters: -p profile=str:fast -p seed=int:1
"""

from __future__ import annotations

import base64
import io
import json
from typing import Any

import cvat_sdk.auto_annotation as cvataa
import foveate
import numpy as np
import PIL.Image


class Function:
    """`track` answers None while the target is occluded or lost."""

    def __init__(self, profile: str = "fast", seed: int = 1) -> None:
        self.profile, self.seed = profile, seed

    @property
    def spec(self) -> cvataa.TrackingFunctionSpec:
        return cvataa.TrackingFunctionSpec(supported_shape_types={"rectangle"})

    def preprocess_image(self, context: Any, image: PIL.Image.Image) -> np.ndarray:
        return np.asarray(image.convert("RGB"))

    def init_tracking_state(self, context: Any, image: np.ndarray, shape: cvataa.TrackableShape) -> dict[str, str]:
        left, top, right, bottom = shape.points
        tracker = foveate.Tracker(self.profile, seed=self.seed)
        tracker.init(image, (left, top, right - left, bottom - top))
        return _state(tracker, image)

    def track(self, context: Any, image: np.ndarray, state: dict[str, str]) -> cvataa.TrackableShape | None:
        tracker = foveate.Tracker(self.profile, seed=self.seed)
        tracker.load(json.dumps(state["tracker"]).encode())
        # What compares pictures has to see the last one again.
        tracker.skip(np.asarray(PIL.Image.open(io.BytesIO(base64.b64decode(state["picture"])))))
        ok, (x, y, w, h) = tracker.update(image)
        state.update(_state(tracker, image))
        return cvataa.TrackableShape(type="rectangle", points=[x, y, x + w, y + h]) if ok else None


def _state(tracker: foveate.Tracker, image: np.ndarray) -> dict[str, Any]:
    """The tracker, and the picture it saw last."""
    png = io.BytesIO()
    PIL.Image.fromarray(image).save(png, "PNG", compress_level=1)
    return {"tracker": json.loads(tracker.save()), "picture": base64.b64encode(png.getvalue()).decode()}


def create(profile: str = "fast", seed: int = 1) -> Function:
    return Function(profile, seed)
