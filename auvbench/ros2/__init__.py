"""ROS 2: the interface of a vehicle in topics, services and parameters, its server and its clients.

rclpy is imported when it is first needed; torch, numba and Hydra never are.
"""
