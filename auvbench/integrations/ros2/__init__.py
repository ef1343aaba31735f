"""Implement the server and the clients of the ROS 2 interface: topics, services and parameters of a vehicle.

The package imports rclpy when first needed, and never imports torch, numba or Hydra.
"""
