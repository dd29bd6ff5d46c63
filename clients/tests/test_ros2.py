"""The ROS 2 node against stand-ins of the messages, which check fields and types as rclpy's classes do; where ROS 2 is installed, the
stand-ins against its definitions.
"""

from __future__ import annotations

import array
import importlib
import math
import sys
import types
from pathlib import Path

import pytest

np = pytest.importorskip("numpy")
foveate = pytest.importorskip("foveate", reason="skipped: no package foveate")
ROOT = Path(__file__).resolve().parents[1] / "ros2"
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import foveate_messages as messages  # noqa: E402
from test_clients import FIRST, drawn, truth  # noqa: E402

# The fields that are used or that surround them, with their types.
FIELDS = {
    "builtin_interfaces/Time": "sec int32, nanosec uint32",
    "std_msgs/Header": "stamp builtin_interfaces/Time, frame_id string",
    "sensor_msgs/Image": "header std_msgs/Header, height uint32, width uint32, encoding string, is_bigendian uint8, step uint32, "
    "data uint8[]",
    "sensor_msgs/RegionOfInterest": "x_offset uint32, y_offset uint32, height uint32, width uint32, do_rectify boolean",
    "sensor_msgs/CameraInfo": "header std_msgs/Header, height uint32, width uint32, distortion_model string, d double[], k double[9], "
    "r double[9], p double[12], binning_x uint32, binning_y uint32, roi sensor_msgs/RegionOfInterest",
    "geometry_msgs/Point": "x double, y double, z double",
    "geometry_msgs/Quaternion": "x double, y double, z double, w double",
    "geometry_msgs/Pose": "position geometry_msgs/Point, orientation geometry_msgs/Quaternion",
    "geometry_msgs/PoseWithCovariance": "pose geometry_msgs/Pose, covariance double[36]",
    "geometry_msgs/PoseWithCovarianceStamped": "header std_msgs/Header, pose geometry_msgs/PoseWithCovariance",
    "vision_msgs/Point2D": "x double, y double",
    "vision_msgs/Pose2D": "position vision_msgs/Point2D, theta double",
    "vision_msgs/BoundingBox2D": "center vision_msgs/Pose2D, size_x double, size_y double",
    "vision_msgs/ObjectHypothesis": "class_id string, score double",
    "vision_msgs/ObjectHypothesisWithPose": "hypothesis vision_msgs/ObjectHypothesis, pose geometry_msgs/PoseWithCovariance",
    "vision_msgs/Detection2D": "header std_msgs/Header, results vision_msgs/ObjectHypothesisWithPose[], bbox vision_msgs/BoundingBox2D, "
    "id string",
    "vision_msgs/Detection2DArray": "header std_msgs/Header, detections vision_msgs/Detection2D[]",
    "diagnostic_msgs/KeyValue": "key string, value string",
    "diagnostic_msgs/DiagnosticStatus": "level octet, name string, message string, hardware_id string, values diagnostic_msgs/KeyValue[]",
    "diagnostic_msgs/DiagnosticArray": "header std_msgs/Header, status diagnostic_msgs/DiagnosticStatus[]",
}
PLAIN = {"double": float, "string": str, "boolean": bool, "octet": bytes}


def fields(name: str) -> dict[str, str]:
    return dict(field.split(" ") for field in FIELDS[name].split(", "))


def check(kind: str, value: object) -> None:
    """As rclpy's setters do in their debug mode."""
    element, bracket, length = kind.partition("[")
    if bracket:
        assert not isinstance(value, (str, bytes)), (kind, value)
        assert length in ("]", f"{len(value)}]"), (kind, value)
        for each in value if element != "uint8" else []:
            check(element, each)
    elif "/" in kind:
        assert type(value).__name__ == kind.split("/")[1], (kind, value)
    elif "int" in kind:
        bits = int(kind.split("int")[1])
        low, high = (0, 2**bits) if kind[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1))
        assert isinstance(value, int) and low <= value < high, (kind, value)
    else:
        assert isinstance(value, PLAIN[kind]) and (kind != "octet" or len(value) == 1), (kind, value)


def initial(name: str, kind: str) -> object:
    element, bracket, length = kind.partition("[")
    if bracket:
        return [0.0] * int(length[:-1]) if length != "]" else []
    if "/" in kind:
        return STAND_INS[kind]()
    return 1.0 if name == "w" else {"octet": b"\0"}.get(kind, PLAIN.get(kind, int)())


def stand_in(full: str) -> type:
    known = fields(full)

    class Message:
        __slots__ = tuple(known)

        def __init__(self, **values: object) -> None:
            for name, kind in known.items():
                setattr(self, name, values.get(name, initial(name, kind)))

        def __setattr__(self, name: str, value: object) -> None:
            assert name in known, f"{full} has no field {name}"
            check(known[name], value)
            object.__setattr__(self, name, value)

    Message.__name__ = full.split("/")[1]
    return Message


STAND_INS: dict[str, type] = {}
for name in FIELDS:
    STAND_INS[name] = stand_in(name)
TYPES = types.SimpleNamespace(**{name.split("/")[1]: message for name, message in STAND_INS.items()})


def header(t: int) -> object:
    return TYPES.Header(stamp=TYPES.Time(sec=5, nanosec=33_000_000 * t), frame_id="camera")


def image(t: int, encoding: str = "rgb8", gap: int = 0, big: int = 0) -> object:
    rgb = drawn(t)
    grey = rgb[:, :, :1]
    pixels = {
        "rgb8": rgb,
        "bgr8": rgb[:, :, ::-1],
        "rgba8": np.concatenate([rgb, grey], axis=2),
        "mono8": grey,
        "mono16": np.concatenate([grey, 255 - grey] if big else [255 - grey, grey], axis=2),
    }[encoding]
    height, width, depth = pixels.shape
    rows = np.full((height, width * depth + gap), 77, np.uint8)
    rows[:, : width * depth] = pixels.reshape(height, -1)
    data = array.array("B", rows.tobytes())
    step = width * depth + gap
    return TYPES.Image(header=header(t), height=height, width=width, encoding=encoding, is_bigendian=big, step=step, data=data)


def box(numbers: tuple[float, ...], stamp: object = None) -> object:
    x, y, width, height = numbers
    detection = TYPES.Detection2D()
    detection.bbox.center.position.x, detection.bbox.center.position.y = x + width / 2, y + height / 2
    detection.bbox.size_x, detection.bbox.size_y = width, height
    if stamp is not None:
        detection.header = stamp
    return detection


def follow(count: int = 8, **kind: object) -> tuple[messages.Follower, list[messages.Tracked]]:
    follower = messages.Follower("fast")
    follower.init(box(FIRST))
    return follower, [follower.image(image(t, **kind), 10.0 + t / 30) for t in range(count)]


def test_definitions_are_those_of_ros() -> None:
    for full in FIELDS:
        package, name = full.split("/")
        module = pytest.importorskip(f"{package}.msg", reason=f"skipped: no package {package}", exc_type=ImportError)
        theirs = getattr(module, name).get_fields_and_field_types()
        assert {key: value.replace("sequence<", "").replace(">", "[]") for key, value in theirs.items()} == fields(full)


@pytest.mark.parametrize(("encoding", "gap", "big"), [("rgb8", 0, 0), ("bgr8", 5, 0), ("rgba8", 8, 0), ("mono8", 3, 1), ("mono16", 2, 0), ("mono16", 0, 1)])
def test_results_are_those_of_the_tracker(encoding: str, gap: int, big: int) -> None:
    _, tracked = follow(encoding=encoding, gap=gap, big=big)
    tracker = foveate.Tracker("fast")
    for t, item in enumerate(tracked):
        pixels = drawn(t) if encoding in ("rgb8", "bgr8", "rgba8") else drawn(t)[:, :, 0]
        seen = tracker.update(pixels) if t else tracker.init(pixels, FIRST)
        found = messages.detections(TYPES, item)
        assert found.header is item.header and messages.nanoseconds(found.header.stamp) == 5 * 10**9 + 33_000_000 * t
        (detection,) = found.detections
        (result,) = detection.results
        centre = detection.bbox.center.position
        assert np.allclose(
            [centre.x - detection.bbox.size_x / 2, centre.y - detection.bbox.size_y / 2, detection.bbox.size_x, detection.bbox.size_y],
            seen.box,
            atol=1e-9,
            rtol=0,
        )
        assert result.hypothesis.score == 1 - seen.p_lost
        covariance = np.reshape(result.pose.covariance, (6, 6))
        assert (covariance[:2, :2] == np.asarray(seen.covariance)[:2, :2]).all() and (covariance == covariance.T).all()
        assert covariance[5, 5] == seen.covariance[5][5] and not covariance[2:5].any()
        assert abs(result.pose.pose.position.x - (centre.x - 0.5)) < 1e-9
        assert np.allclose(seen.box, truth(t), atol=4)


def test_a_box_starts_on_the_picture_with_its_stamp() -> None:
    follower, tracked = follow()
    late = messages.Follower("fast")
    for t in range(6):
        assert messages.detections(TYPES, late.image(image(t), 10.0)).detections == []
    # It comes when picture 5 has been taken: those since picture 0 are tracked at once.
    since = late.init(box(FIRST, header(0)))
    since += [late.image(image(t), 10.0) for t in (6, 7)]
    assert [item.seen.box for item in since] == [item.seen.box for item in tracked]
    with pytest.raises(ValueError, match="stamp"):
        late.init(box(FIRST, header(90)))
    assert late.seen is not None, "nothing has changed"
    with pytest.raises(ValueError):
        late.init(box((0.0, 0.0, math.nan, 4.0)))
    seen = late.seen
    with pytest.raises(ValueError):
        late.init(box((9000.0, 9000.0, 30.0, 30.0), header(7)))
    assert late.seen is seen and late.image(image(7), 10.0).seen.ok, "a box that does not fit keeps the target"
    late.reset()
    assert messages.detections(TYPES, late.image(image(8), 10.0)).detections == []


def test_pictures_that_do_not_fit_are_refused_and_the_next_one_is_tracked() -> None:
    follower, _ = follow()
    for bad in ({"encoding": "yuv422"}, {"step": 10}, {"height": 200}, {"width": 0}):
        message = image(8)
        for name, value in bad.items():
            setattr(message, name, value)
        assert follower.image(message, 11.0) is None and follower.error
        assert follower.state(11.0, 1.0)[0] == messages.ERROR
    assert follower.image(image(8), 11.0).seen.ok


def test_another_order_of_colours_is_refused() -> None:
    follower, _ = follow()
    assert follower.image(image(8, "bgr8"), 11.0) is None and "bgr" in follower.error
    assert follower.image(image(8), 11.0).seen.ok
    late = messages.Follower("fast")
    for t in range(3):
        late.image(image(t, "bgr8" if t else "rgb8"), 10.0)
    with pytest.raises(ValueError, match="order of colours is bgr"):
        late.init(box(FIRST, header(0)))


def info(model: str, d: list[float], **more: object) -> object:
    k = [400.0, 0.0, 310.5, 0.0, 380.0, 236.25, 0.0, 0.0, 1.0]
    p = [390.0, 0.0, 300.0, 0.0, 0.0, 395.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    return TYPES.CameraInfo(height=480, width=640, distortion_model=model, d=d, k=k, p=p, **more)


def project(model: str, d: list[float], ray: np.ndarray) -> np.ndarray:
    """The pixel of a ray, from the definitions of the distortion models."""
    x, y = ray[:2] / ray[2]
    r = math.hypot(x, y)
    if model == "equidistant":
        t = math.atan(r)
        scale = t * (1 + sum(k * t ** (2 * i + 2) for i, k in enumerate(d))) / r
        x, y = x * scale, y * scale
    elif d:
        k1, k2, p1, p2, k3, *rest = d
        k4, k5, k6 = rest or (0, 0, 0)
        radial = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
        x, y = (
            x * radial + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2),
            y * radial + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y,
        )
    return np.array([400 * x + 310.5, 380 * y + 236.25])


MODELS = [
    ("plumb_bob", []),
    ("plumb_bob", [-0.21, 0.06, 0.001, -0.002, -0.004]),
    ("rational_polynomial", [0.3, 0.02, 0.001, 0.0005, 0.001, 0.5, 0.04, 0.002]),
    ("equidistant", [-0.02, 0.004, -0.001, 0.0002]),
]


@pytest.mark.parametrize(("model", "d"), MODELS)
def test_directions_undo_the_distortion(model: str, d: list[float]) -> None:
    camera = messages.Camera(info(model, d))
    for x in np.linspace(-0.6, 0.6, 5):
        for y in np.linspace(-0.5, 0.5, 5):
            ray = np.array([x, y + 1e-3, 1.0]) / np.linalg.norm([x, y + 1e-3, 1.0])
            assert np.allclose(camera.direction(*project(model, d, ray)), ray, atol=1e-9)


def test_binning_and_regions_shift_pixels() -> None:
    whole = messages.Camera(info("plumb_bob", []))
    roi = TYPES.RegionOfInterest(x_offset=100, y_offset=50)
    part = messages.Camera(info("plumb_bob", [], binning_x=2, binning_y=2, roi=roi))
    # Pixel 10 of the binned picture covers 20 and 21 of the region.
    assert np.allclose(part.direction(10, 20), whole.direction(120.5, 90.5))


def test_cameras_without_calibration_are_refused() -> None:
    for bad in (info("fancy", [0.1]), TYPES.CameraInfo()):
        with pytest.raises(ValueError):
            messages.Camera(bad)
    rectified = messages.Camera(info("fancy", [0.1]), rectified=True)
    assert np.allclose(rectified.direction(300, 240), [0, 0, 1])


@pytest.mark.parametrize(("model", "d"), [("plumb_bob", [-0.45, 0.25, 0, 0, -0.09]), ("equidistant", [-0.5, 0, 0, 0])])
def test_there_is_no_bearing_outside_the_border_of_the_distortion(model: str, d: list[float]) -> None:
    camera = messages.Camera(info(model, list(map(float, d))))
    seen = lambda u: types.SimpleNamespace(box=(u, 230.0, 9.0, 9.0), covariance=np.eye(6))
    bearing = lambda u: messages.bearing(TYPES, messages.Tracked(header(0), seen(u)), camera)
    ray = camera.direction(410.5, 236.25)
    assert np.allclose(project(model, d, ray), [410.5, 236.25]) and bearing(410.0) is not None
    for u in (640.0, 700.0, 1e4, 1e9, -1e9):
        assert camera.direction(u, 236.25) is None and camera.angles(u, 200.0) is None and bearing(u) is None, u


@pytest.mark.parametrize(("model", "d"), MODELS)
def test_a_bearing_turns_the_axis_to_the_target_with_its_covariance(model: str, d: list[float]) -> None:
    _, tracked = follow()
    camera, seen = messages.Camera(info(model, d)), tracked[-1].seen
    message = messages.bearing(TYPES, tracked[-1], camera)
    q = message.pose.pose.orientation
    x, y, z, w = q.x, q.y, q.z, q.w
    axis = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    u, v = seen.box.x + seen.box.w / 2 - 0.5, seen.box.y + seen.box.h / 2 - 0.5
    assert np.allclose(axis, camera.direction(u, v), atol=1e-12)
    # 4,000 draws of the place, seed 1: each entry is off by less than a tenth of the larger variance.
    spread = np.asarray(seen.covariance)[:2, :2]
    places = np.random.default_rng(1).multivariate_normal([u, v], spread, 4000)
    expected = np.cov([camera.angles(*place) for place in places], rowvar=False)
    covariance = np.reshape(message.pose.covariance, (6, 6))
    assert np.abs(covariance[3:5, 3:5] - expected).max() < 0.1 * expected.max()
    covariance[3:5, 3:5] = 0
    assert not covariance.any()


def test_diagnostics_report_the_status_and_missing_pictures() -> None:
    follower, _ = follow()
    tell = lambda now: messages.diagnostics(TYPES, TYPES.Time(sec=9), follower, now, 1.0, "foveate").status[0]
    status = tell(10.5)
    assert (status.level, status.message) == (messages.OK, "tracking") and status.values[0].value == "8"
    assert tell(11.9).level == messages.STALE and "1.7 s" in tell(11.9).message
    follower.reset()
    assert tell(10.5).level == messages.WARN and "init" in tell(10.5).message
    assert messages.Follower().state(0.0, 1.0) == (messages.STALE, "no picture yet")


class Stub(types.SimpleNamespace):
    """rclpy's Node, as far as the node uses it: it records the published messages."""

    def __init__(self, name: str) -> None:
        super().__init__(name=name, parts={}, published={}, errors=[])

    def declare_parameter(self, name: str, default: object) -> object:
        return types.SimpleNamespace(value={"profile": "fast"}.get(name, default))

    def create_publisher(self, kind: type, topic: str, _: object) -> object:
        into = self.published.setdefault(topic, [])

        def publish(message: object) -> None:
            assert isinstance(message, kind)
            into.append(message)

        return types.SimpleNamespace(publish=publish)

    def create_subscription(self, kind: type, topic: str, call: object, _: object) -> None:
        self.parts[topic] = call

    def create_service(self, kind: type, name: str, call: object) -> None:
        self.parts[name] = call

    def create_timer(self, period: float, call: object) -> None:
        self.parts["timer"] = call

    def get_clock(self) -> object:
        now = types.SimpleNamespace(nanoseconds=10**10, to_msg=lambda: TYPES.Time(sec=10))
        return types.SimpleNamespace(now=lambda: now)

    def get_logger(self) -> object:
        return types.SimpleNamespace(error=lambda text, **_: self.errors.append(text))

    def get_name(self) -> str:
        return self.name


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> object:
    """The node on stubs of rclpy and the message packages."""
    parts: dict[str, dict[str, object]] = {
        "rclpy": {"init": None},
        "rclpy.node": {"Node": Stub},
        "rclpy.qos": {"QoSProfile": types.SimpleNamespace, "ReliabilityPolicy": types.SimpleNamespace(BEST_EFFORT=2)},
        "std_srvs.srv": {"Trigger": types.SimpleNamespace(Request=None, Response=None)},
    }
    for full, message in STAND_INS.items():
        package, name = full.split("/")
        parts.setdefault(f"{package}.msg", {})[name] = message
    for name, content in parts.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        for whole in {name.split(".")[0], name}:
            monkeypatch.setitem(sys.modules, whole, module if whole == name else sys.modules.get(whole, types.ModuleType(whole)))
    monkeypatch.delitem(sys.modules, "foveate_node", raising=False)
    return importlib.import_module("foveate_node").FoveateNode()


def test_the_node_publishes_what_it_is_shown(node: Stub) -> None:
    call = node.parts
    call["camera_info"](info("plumb_bob", []))
    call["camera_info"](info("plumb_bob", []))
    call["init"](box(FIRST))
    for t in range(4):
        call["image"](image(t))
    call["timer"]()
    assert len(node.published["detections"]) == len(node.published["bearing"]) == 4
    assert all(array.detections for array in node.published["detections"])
    assert node.published["/diagnostics"][-1].status[0].message == "tracking"
    assert call["reset"](None, types.SimpleNamespace()).success
    call["image"](image(4))
    assert node.published["detections"][-1].detections == [] and len(node.published["bearing"]) == 4
    call["init"](box(FIRST, header(1)))
    assert len(node.published["detections"]) == 9, "pictures 1 to 4 are tracked at once"
    assert not node.errors
    call["init"](box(FIRST, header(99)))
    call["image"](TYPES.Image(header=header(5)))
    call["camera_info"](info("fancy", [0.1]))
    assert len(node.errors) == 3
