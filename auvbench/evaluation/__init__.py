"""Test agents by a fixed protocol, with the same scenarios for every agent and one row per episode."""
