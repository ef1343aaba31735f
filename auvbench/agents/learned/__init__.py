"""Policies that are trained: Stable-Baselines3's algorithms."""
