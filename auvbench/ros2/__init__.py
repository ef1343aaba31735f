"""ROS 2: the interface of a vehicle in topics, services and parameters; the server behind it, and its clients.

Nothing here imports rclpy before it is asked for, and nothing imports torch, numba or Hydra.
"""
