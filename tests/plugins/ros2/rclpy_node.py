"""A plain node of rclpy: flies a metre ahead by /odom, counts the images, and ends."""

import json
import sys

import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image


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


rclpy.init()
node = Ahead()
while not node.done:
    rclpy.spin_once(node, timeout_sec=0.1)
sys.stdout.write(json.dumps({"images": node.images}))
node.destroy_node()
rclpy.shutdown()
