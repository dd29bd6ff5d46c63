"""Between ROS 2's messages and foveate, without rclpy: pictures in, detections, bearings and diagnostics out.

Message classes come as attributes of an object `types`, so that tests may give others. docs/live.md has the table of the mapping.
"""

from __future__ import annotations

import collections
import math
from typing import Any, NamedTuple

import foveate
import numpy as np

# Encoding of sensor_msgs/Image: bytes of a pixel, and the order that foveate.Tracker is given.
ENCODINGS = {
    "rgb8": (3, "rgb"),
    "bgr8": (3, "bgr"),
    "8UC3": (3, "bgr"),
    "rgba8": (4, "rgba"),
    "bgra8": (4, "bgra"),
    "8UC4": (4, "bgra"),
    "mono8": (1, "rgb"),
    "8UC1": (1, "rgb"),
    "mono16": (2, "rgb"),
    "16UC1": (2, "rgb"),
}
# How far a direction may be off, in focal lengths: a thousandth of a pixel in pictures of 1000 pixels.
CLOSE = 1e-6
OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))


def picture(image: Any) -> tuple[np.ndarray, str]:
    """The pixels of a sensor_msgs/Image, read in place, and their order. Of 16 bits the upper 8 are used."""
    if image.encoding not in ENCODINGS:
        raise ValueError(f"the encoding is {image.encoding!r}; expected one of {', '.join(ENCODINGS)}")
    depth, channels = ENCODINGS[image.encoding]
    height, width, step, size = image.height, image.width, image.step, len(image.data)
    if min(height, width) < 1 or step < width * depth or size < step * (height - 1) + width * depth:
        raise ValueError(f"{width} x {height} pixels of {depth} bytes do not fit {size} bytes with a step of {step}")
    data = np.frombuffer(image.data, np.uint8)
    pixels = np.lib.stride_tricks.as_strided(data, (height, width, depth), (step, depth, 1), writeable=False)
    if depth == 2:
        return pixels[:, :, 0 if image.is_bigendian else 1], channels
    return pixels[:, :, 0] if depth == 1 else pixels, channels


def nanoseconds(stamp: Any) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


class Tracked(NamedTuple):
    """What follows from one picture: its header, and the target, None without one."""

    header: Any
    seen: foveate.Result | None


class Follower:
    """Follows one target through messages. It keeps the last pictures, so that a box that comes late starts in the picture it belongs to."""

    def __init__(self, profile: str = "balanced", seed: int | None = None, history: int = 30) -> None:
        self.profile, self.seed = profile, seed
        self.pictures: collections.deque[tuple[Any, np.ndarray, str]] = collections.deque(maxlen=max(1, history))
        self.tracker: foveate.Tracker | None = None
        self.box: tuple[float, ...] | None = None  # for the next picture
        self.seen: foveate.Result | None = None
        self.frames, self.arrived, self.error = 0, -math.inf, ""

    def image(self, message: Any, now: float) -> Tracked | None:
        """Takes a sensor_msgs/Image at a time in seconds. None for an unusable one: `error` has the reason."""
        self.arrived, self.seen, self.error = now, None, ""
        try:
            pixels, channels = picture(message)
            if self.box is not None:
                box, self.box = self.box, None
                self._begin(message.header, pixels, channels, box)
            elif self.tracker:
                self._update(message.header, pixels, channels)
        except (ValueError, TypeError) as problem:
            self.error = str(problem)
            return None
        self.frames += 1
        self.pictures.append((message.header, pixels, channels))
        return Tracked(message.header, self.seen)

    def init(self, detection: Any) -> list[Tracked]:
        """Starts on the box of a vision_msgs/Detection2D: in the next picture if its stamp is 0, else in the kept picture with its stamp.
        Returns the results of that picture and of those since. ValueError if no such picture is kept, the box does not fit, or a picture
        since then has another size or order of colours."""
        stamp, box = nanoseconds(detection.header.stamp), _box(detection.bbox)
        if not all(map(math.isfinite, box)) or min(box[2:]) <= 0:
            raise ValueError(f"the box is {box}; expected finite numbers of pixels, and sides above 0")
        if stamp == 0:
            self.reset()
            self.box = box
            return []
        kept = list(self.pictures)
        at = [i for i, (header, _, _) in enumerate(kept) if nanoseconds(header.stamp) == stamp]
        if not at:
            raise ValueError(f"none of the last {len(kept)} pictures has the stamp {stamp} ns; give the stamp of a picture, or 0")
        header, pixels, channels = kept[at[-1]]
        tracked = [Tracked(header, self._begin(header, pixels, channels, box))]
        self.box = None
        for header, pixels, channels in kept[at[-1] + 1 :]:
            tracked.append(Tracked(header, self._update(header, pixels, channels)))
        return tracked

    def reset(self) -> None:
        """Stops following."""
        self.tracker = self.box = self.seen = None

    def _begin(self, header: Any, pixels: np.ndarray, channels: str, box: tuple[float, ...]) -> foveate.Result:
        tracker = foveate.Tracker(self.profile, seed=self.seed, channels=channels)
        tracker.set_time(nanoseconds(header.stamp) / 1e9)
        self.seen = tracker.init(pixels, box)
        self.tracker = tracker
        return self.seen

    def _update(self, header: Any, pixels: np.ndarray, channels: str) -> foveate.Result:
        if pixels.ndim == 3 and channels != self.tracker.channels:
            raise ValueError(f"the order of colours is {channels}, that of the first picture {self.tracker.channels}; give the box again")
        self.tracker.set_time(nanoseconds(header.stamp) / 1e9)
        self.seen = self.tracker.update(pixels)
        return self.seen

    def state(self, now: float, timeout: float) -> tuple[bytes, str]:
        """Level and text of the diagnostics at a time in seconds."""
        silent = now - self.arrived
        if silent > timeout:
            return STALE, "no picture yet" if math.isinf(silent) else f"no picture for {silent:.1f} s"
        if self.error:
            return ERROR, self.error
        if self.seen is None:
            return WARN, "no target: publish its box on the topic init"
        level = OK if self.seen.ok else ERROR if self.seen.status == "lost" else WARN
        return level, self.seen.status


def _box(bbox: Any) -> tuple[float, ...]:
    """Left, top, width, height of a vision_msgs/BoundingBox2D."""
    centre = bbox.center.position
    return centre.x - bbox.size_x / 2, centre.y - bbox.size_y / 2, bbox.size_x, bbox.size_y


def detections(types: Any, tracked: Tracked, class_id: str = "target") -> Any:
    """A vision_msgs/Detection2DArray: one detection if there is a target."""
    array = types.Detection2DArray()
    array.header = tracked.header
    seen = tracked.seen
    if seen is None:
        return array
    detection, result = types.Detection2D(), types.ObjectHypothesisWithPose()
    detection.header, detection.id = tracked.header, "1"
    x, y, width, height = seen.box
    detection.bbox.center.position.x, detection.bbox.center.position.y = x + width / 2, y + height / 2
    detection.bbox.size_x, detection.bbox.size_y = width, height
    result.hypothesis.class_id, result.hypothesis.score = class_id, 1.0 - seen.p_lost
    pose = result.pose.pose
    pose.position.x, pose.position.y = _centre(seen)
    angle = seen.state.angle
    pose.orientation.z, pose.orientation.w = math.sin(angle / 2), math.cos(angle / 2)
    result.pose.covariance = _spread(np.asarray(seen.covariance)[np.ix_([0, 1, 5], [0, 1, 5])], [0, 1, 5])
    detection.results = [result]
    array.detections = [detection]
    return array


def _centre(seen: foveate.Result) -> tuple[float, float]:
    """The centre where the top-left pixel has its own at (0, 0), as a camera matrix counts."""
    x, y, width, height = seen.box
    return x + width / 2 - 0.5, y + height / 2 - 0.5


def _spread(covariance: np.ndarray, places: list[int]) -> list[float]:
    """The 36 numbers of x, y, z and the rotations about them, 0 except for those of these places."""
    full = np.zeros((6, 6))
    full[np.ix_(places, places)] = covariance
    return full.ravel().tolist()


class Camera:
    """The directions of the pixels of a sensor_msgs/CameraInfo. ValueError if it is not calibrated, or its distortion model is unknown."""

    def __init__(self, info: Any, rectified: bool = False) -> None:
        k = np.asarray(info.p if rectified else info.k, float).reshape(3, -1)[:, :3]
        if k[0, 0] == 0 or k[1, 1] == 0:
            raise ValueError("the camera is not calibrated: the focal length is 0")
        self.matrix = k
        self.distortion = np.zeros(0) if rectified else np.asarray(info.d, float)
        self.model = info.distortion_model if self.distortion.any() else ""
        if self.model not in ("", "plumb_bob", "rational_polynomial", "equidistant"):
            raise ValueError(f"the distortion model is {self.model!r}; expected plumb_bob, rational_polynomial or equidistant")
        # Without binning and region these are 0.
        self.binning = max(1, info.binning_x), max(1, info.binning_y)
        self.offset = info.roi.x_offset, info.roi.y_offset

    def direction(self, u: float, v: float) -> np.ndarray | None:
        """The unit vector through a pixel of the picture: x right, y down, z forward. None outside the border of the distortion."""
        u, v = ((at + 0.5) * by - 0.5 + off for at, by, off in zip((u, v), self.binning, self.offset))
        k = self.matrix
        y = (v - k[1, 2]) / k[1, 1]
        distorted = np.array([(u - k[0, 2] - k[0, 1] * y) / k[0, 0], y])
        if self.model == "equidistant":
            radius = float(np.hypot(*distorted))
            off = lambda t: t * (1 + np.polyval([*self.distortion[3::-1], 0.0], t * t)) - radius
            theta = _solve(off, radius)
            if not (abs(off(theta)) < CLOSE and -CLOSE < theta <= math.pi):
                return None
            sine = math.sin(theta) / radius if radius else 1.0
            return np.array([*(distorted * sine), math.cos(theta)])
        plane = distorted
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(100 if self.model else 0):
                plane, before = plane - (self._distort(plane) - distorted), plane
                if np.abs(plane - before).max() < 1e-12:
                    break
            # False of NaN, too.
            if not np.abs(self._distort(plane) - distorted).max() < CLOSE:
                return None
        ray = np.array([*plane, 1.0])
        return ray / np.linalg.norm(ray)

    def _distort(self, plane: np.ndarray) -> np.ndarray:
        k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(self.distortion[:8], (0, max(0, 8 - len(self.distortion))))
        x, y = plane
        r2 = x * x + y * y
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        skew = np.array([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y])
        return plane * radial + skew

    def angles(self, u: float, v: float) -> np.ndarray | None:
        """The rotations about x and then y, radians, that turn the optical axis to a pixel; None as `direction`."""
        ray = self.direction(u, v)
        if ray is None:
            return None
        x, y, z = ray
        return np.array([math.atan2(-y, math.hypot(x, z)), math.atan2(x, z)])


def _solve(f: Any, start: float) -> float:
    """A zero of a function near `start`, by the secant method."""
    a, b = start, start + 1e-4
    fa, fb = f(a), f(b)
    for _ in range(50):
        if fb == fa or abs(b - a) < 1e-14:
            break
        a, b, fa = b, b - fb * (b - a) / (fb - fa), fb
        fb = f(b)
    return b


def bearing(types: Any, tracked: Tracked, camera: Camera) -> Any:
    """A geometry_msgs/PoseWithCovarianceStamped at the camera whose z axis points to the target; None without one, or if the camera
    has no direction there. The covariance is that of the rotations about x and y, radians squared."""
    seen = tracked.seen
    if seen is None:
        return None
    u, v = _centre(seen)
    step = 0.5  # pixels
    places = ((0, 0), (step, 0), (-step, 0), (0, step), (0, -step))
    angles = [camera.angles(u + a, v + b) for a, b in places]
    if any(each is None for each in angles):
        return None
    message = types.PoseWithCovarianceStamped()
    message.header = tracked.header
    about_x, about_y = angles[0] / 2
    q = message.pose.pose.orientation
    # About x, then about y.
    q.x, q.y = math.sin(about_x) * math.cos(about_y), math.cos(about_x) * math.sin(about_y)
    q.z, q.w = -math.sin(about_x) * math.sin(about_y), math.cos(about_x) * math.cos(about_y)
    jacobian = np.stack([angles[1] - angles[2], angles[3] - angles[4]], axis=1) / (2 * step)
    message.pose.covariance = _spread(jacobian @ np.asarray(seen.covariance)[:2, :2] @ jacobian.T, [3, 4])
    return message


def diagnostics(types: Any, stamp: Any, follower: Follower, now: float, timeout: float, name: str) -> Any:
    """A diagnostic_msgs/DiagnosticArray with one status."""
    array, status = types.DiagnosticArray(), types.DiagnosticStatus()
    array.header.stamp = stamp
    status.level, status.message = follower.state(now, timeout)
    status.name = name
    seen = follower.seen
    values = {"pictures": follower.frames, "profile": follower.profile}
    if seen is not None:
        values |= {"status": seen.status, "P(lost)": f"{seen.p_lost:.3f}"}
    for key, value in values.items():
        pair = types.KeyValue()
        pair.key, pair.value = key, str(value)
        status.values.append(pair)
    array.status = [status]
    return array
