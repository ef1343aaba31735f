"""Tests: a fixed protocol, the same scenarios for every agent, a row per episode."""
