"""Implement the ROS 2 interface of a vehicle in topics, services and parameters: its server and its clients.

rclpy is imported when first needed; torch, numba and Hydra never are.
"""
