"""Checkpoints from which a run continues with the same bits; docs/resume.md explains them.

A training loop uses `saver.Checkpointer`. Nothing is imported here, so that reading files does not import torch.
"""
