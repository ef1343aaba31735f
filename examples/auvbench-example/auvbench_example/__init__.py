"""Two agents, a task and a reward for auvbench."""
