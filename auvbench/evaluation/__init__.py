"""Tests: a fixed protocol, the same scenarios for every agent, one row per episode."""
