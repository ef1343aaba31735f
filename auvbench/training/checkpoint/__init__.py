"""Checkpoints that continue a run with the same bits; docs/resume.md says what that means exactly.

`callback.Checkpointer` is what a training loop uses. Nothing is imported here, so that those who only want to
look at files do not wait for torch.
"""
