"""A controller, a learner, a task and a reward for auvbench."""
