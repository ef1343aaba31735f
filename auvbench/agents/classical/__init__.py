"""Controllers without learning: PID, its version for vehicles with fins, the random agent."""
