"""Controllers with nothing to learn: PID, its version for vehicles with fins, the random floor."""
