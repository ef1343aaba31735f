"""Compare the embedded simulator with Gazebo: `make parity`."""
