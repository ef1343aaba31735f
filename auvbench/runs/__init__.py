"""Runs on disk: identity, directory, atomic files, digests, ownership, locks and status."""
