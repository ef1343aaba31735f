"""Checkpoints from which a run continues bit-identically; docs/resume.md explains them.

A training loop uses `saver.Checkpointer`. This module imports nothing, so that code that only reads the files of a run does
not import torch.
"""
