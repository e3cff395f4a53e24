"""A plain node of rclpy: flies a metre ahead by /odom, counts the images, and ends."""

import json
import sys

import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger


class Ahead(Node):  # type: ignore[misc]  # of a package that is seldom installed
    def __init__(self) -> None:
        super().__init__("ahead")
        self.images = 0
        self.north: float | None = None
        self.done = False
        self.publisher = self.create_publisher(TwistStamped, "/cmd_vel", 5)
        self.create_subscription(Image, "/camera/image_raw", self.image, qos_profile_sensor_data)
        self.create_subscription(Odometry, "/odom", self.odometry, qos_profile_sensor_data)

    def image(self, message: Image) -> None:
        self.images += message.height > 0

    def odometry(self, message: Odometry) -> None:
        north = message.pose.pose.position.y
        self.north = north if self.north is None else self.north
        self.done = north > self.north + 1.0
        command = TwistStamped()
        command.header.stamp = message.header.stamp
        command.header.frame_id = "base_link"
        command.twist.linear.x = 0.5
        self.publisher.publish(command)


def call(node: Node, name: str) -> Trigger.Response:
    client = node.create_client(Trigger, name)
    if not client.wait_for_service(timeout_sec=60.0):
        sys.exit(f"there is no service {name}")
    answer = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, answer, timeout_sec=60.0)
    return answer.result()


def mismatched() -> Node:
    """Return a node whose subscriptions get nothing of the run's: one by type, one by quality."""
    node = rclpy.create_node("mismatched")
    node.create_subscription(TwistStamped, "/pose", lambda _: None, qos_profile_sensor_data)
    late = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(Odometry, "/odom", lambda _: None, late)
    return node


rclpy.init()
if "mismatched" in sys.argv:
    rclpy.spin(mismatched())  # the run ends this process
node = Ahead()
goal = ""
while not node.done:
    rclpy.spin_once(node, timeout_sec=0.1)
    if node.images == 10 and not goal:
        goal = call(node, "/wil/goal").message
if "abort" in sys.argv:
    node.done = not call(node, "/wil/abort").success
    while not node.done:  # the run ends this process
        rclpy.spin_once(node, timeout_sec=0.1)
sys.stdout.write(json.dumps({"images": node.images, "goal": goal}))
node.destroy_node()
rclpy.shutdown()
