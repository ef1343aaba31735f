"""Send a pilot's commands over ROS 2: the `Sender` of the pilot's supervisor, whose process must not import auvbench."""

import struct
from typing import Any


class Sender:
    """Sends commands over ROS 2 topics, a std_msgs/Float64 for each actuator."""

    done = "zero thrust was sent"

    def __init__(self, depth: str, node: str, *topics: str) -> None:
        from rclpy import init
        from rclpy.context import Context
        from rclpy.duration import Duration
        from rclpy.node import Node
        from rclpy.signals import SignalHandlerOptions
        from std_msgs.msg import Float64

        self.message, self.share = Float64, Duration(seconds=1.0 / len(topics))
        context = Context()
        init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        options: dict[str, Any] = {"use_global_arguments": False, "start_parameter_services": False}
        self.node: Any = Node(node, context=context, enable_rosout=False, **options)
        self.publishers = [self.node.create_publisher(Float64, topic, int(depth)) for topic in topics]
        self.shutdown = context.shutdown

    def ready(self) -> bool:
        return all(publisher.get_subscription_count() > 0 for publisher in self.publishers)

    def send(self, data: bytes) -> None:
        for publisher, (value,) in zip(self.publishers, struct.iter_unpack("=d", data), strict=True):
            publisher.publish(self.message(data=value))

    def close(self) -> None:
        for publisher in self.publishers:
            publisher.wait_for_all_acked(self.share)
        self.node.destroy_node()
        self.shutdown()
