"""Tasks: scenarios, observations, rewards, outcomes and disturbances of episodes."""
