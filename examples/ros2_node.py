"""ROS 2 node that receives clouds of markers (`markers`) and publishes the angle (`angle`, rad)."""

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64

from estimation import Tracker, layout_markers, read_points, stamp_message


class AngleNode(Node):
    """Publishes an angle for every cloud; the first cloud must show the unloaded pad."""

    def __init__(self) -> None:
        super().__init__("contactmodel")
        self.tracker: Tracker | None = None
        self.angle = self.create_publisher(Float64, "angle", 10)
        self.create_subscription(PointCloud2, "markers", self.receive, 10)

    def receive(self, message: PointCloud2) -> None:
        """Publish the angle; NaN where unknown."""
        seen = read_points(stamp_message(message))
        self.tracker = self.tracker or Tracker(layout_markers(seen.positions))
        answer = self.tracker.update_positions(seen.positions, seen.time)
        self.angle.publish(Float64(data=answer.angle))


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(AngleNode())
