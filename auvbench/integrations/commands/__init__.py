"""Commands that talk to foreign systems."""
