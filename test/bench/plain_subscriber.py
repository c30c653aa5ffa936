"""The alternative: an rclpy subscriber whose callback does nothing."""

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

rclpy.init()
node = rclpy.create_node("plain_subscriber")
node.create_subscription(JointState, "joint_states", lambda message: None, qos_profile_sensor_data)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
