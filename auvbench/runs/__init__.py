"""Runs: identity, directory, manifest, checkpoints, the training loop, scheduling."""
