"""Train one run: the worker process, the training loop, interruption, checkpoints.

Nothing is imported here, so that reading files does not import torch.
"""
