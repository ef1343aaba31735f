"""One run carried out: the worker process, the training loop, interruption, checkpoints.

Nothing is imported here, so that those who only want to look at files do not wait for torch.
"""
