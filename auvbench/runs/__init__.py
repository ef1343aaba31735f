"""A run on disk: identity, directory, files that are whole or absent, digests, ownership, locks and status."""
