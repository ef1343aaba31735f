"""Two contestants, a task and a reward for auvbench."""
