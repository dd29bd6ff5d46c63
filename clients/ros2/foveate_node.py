"""A ROS 2 node that follows one target: sensor_msgs/Image in, vision_msgs/Detection2DArray out. docs/live.md describes it.

    ros2 run foveate_ros foveate_node --ros-args -r image:=/camera/image_raw -r camera_info:=/camera/camera_info
"""

from __future__ import annotations

from types import SimpleNamespace

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose

import foveate_messages as messages

TYPES = SimpleNamespace(
    Detection2D=Detection2D,
    Detection2DArray=Detection2DArray,
    DiagnosticArray=DiagnosticArray,
    DiagnosticStatus=DiagnosticStatus,
    KeyValue=KeyValue,
    ObjectHypothesisWithPose=ObjectHypothesisWithPose,
    PoseWithCovarianceStamped=PoseWithCovarianceStamped,
)


class FoveateNode(Node):
    def __init__(self) -> None:
        super().__init__("foveate")
        value = lambda name, default: self.declare_parameter(name, default).value
        self.follower = messages.Follower(value("profile", "balanced"), value("seed", 1), value("history", 30))
        self.timeout, self.rectified = value("timeout", 1.0), value("rectified", False)
        self.class_id = value("class_id", "target")
        self.camera: messages.Camera | None = None
        self.info: CameraInfo | None = None
        self.detections = self.create_publisher(Detection2DArray, "detections", 10)
        self.bearings = self.create_publisher(PoseWithCovarianceStamped, "bearing", 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # The newest picture only: while one is tracked, others are dropped.
        quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(Image, "image", self.on_image, quality)
        self.create_subscription(CameraInfo, "camera_info", self.on_info, quality)
        self.create_subscription(Detection2D, "init", self.on_init, 10)
        self.create_service(Trigger, "reset", self.on_reset)
        self.create_timer(min(1.0, self.timeout), self.on_timer)

    def now(self) -> float:
        return self.get_clock().now().nanoseconds / 1e9

    def publish(self, tracked: messages.Tracked) -> None:
        self.detections.publish(messages.detections(TYPES, tracked, self.class_id))
        bearing = messages.bearing(TYPES, tracked, self.camera) if self.camera else None
        if bearing is not None:
            self.bearings.publish(bearing)

    def on_image(self, image: Image) -> None:
        tracked = self.follower.image(image, self.now())
        if tracked is None:
            self.get_logger().error(self.follower.error, throttle_duration_sec=5.0)
        else:
            self.publish(tracked)

    def on_info(self, info: CameraInfo) -> None:
        fields = ("k", "d", "p", "distortion_model", "binning_x", "binning_y", "roi")
        if self.info is not None and all(_same(getattr(info, name), getattr(self.info, name)) for name in fields):
            return
        self.info = info
        try:
            self.camera = messages.Camera(info, self.rectified)
        except ValueError as problem:
            self.camera = None
            self.get_logger().error(f"no bearings: {problem}")

    def on_init(self, detection: Detection2D) -> None:
        try:
            for tracked in self.follower.init(detection):
                self.publish(tracked)
        except ValueError as problem:
            self.get_logger().error(f"init: {problem}")

    def on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.follower.reset()
        response.success, response.message = True, "no target"
        return response

    def on_timer(self) -> None:
        stamp = self.get_clock().now().to_msg()
        self.diagnostics.publish(messages.diagnostics(TYPES, stamp, self.follower, self.now(), self.timeout, self.get_name()))


def _same(a: object, b: object) -> bool:
    return list(a) == list(b) if hasattr(a, "__len__") else a == b


def main() -> None:
    rclpy.init()
    node = FoveateNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
