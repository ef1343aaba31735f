"""Train one run: the worker process, the training loop, interruption, checkpoints.

This module imports nothing, so that code that only reads the files of a run does not import torch.
"""
