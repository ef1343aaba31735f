"""Agents without learning: classical and model-predictive controllers, and the random agent."""
