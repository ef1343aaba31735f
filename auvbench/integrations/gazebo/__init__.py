"""Simulate in Gazebo Harmonic: vehicles and worlds as SDF, and the simulator that steps them in process."""
