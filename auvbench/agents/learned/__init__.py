"""Learned policies: Stable-Baselines3's algorithms, residual policies and PETS."""
