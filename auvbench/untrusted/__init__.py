"""Read files that another person may have written (run folders, sheets, configurations), or that a disk may
have damaged.

Every reader limits the size and nesting of a file, and the expansion of aliases and archives in it. A file that breaks a
limit causes a `ValueError` with a message of one line. No reader runs code from a file or follows a link out of a run.
SECURITY.md describes what is trusted.
"""
