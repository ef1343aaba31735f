"""Read files that another person may have written (run folders, sheets, configurations), or that a disk may
have damaged.

Every reader is limited (bytes, nesting, expansion of aliases and archives) and raises a `ValueError` of one
line. No reader runs code or follows a link out of a run. SECURITY.md describes what is trusted.
"""
