"""What is asked of a controller: scenario, observation, reward, ends; disturbances."""
