"""Tasks: scenario, observation, reward and ends of an episode, and disturbances."""
