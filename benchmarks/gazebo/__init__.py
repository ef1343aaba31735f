"""The embedded simulator and Gazebo side by side: `make parity` and `make transfer`."""
