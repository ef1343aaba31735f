"""The simulator against numbers that others published; `page.py` writes them to docs/verification.md."""
