"""Reading files that another person may have written: run folders, sheets, configurations; or a damaged disk.

Every reader is bounded (bytes, nesting, what an alias or an archive expands to) and raises a `ValueError` of one line.
No reader runs code or follows a link out of a run. SECURITY.md says what is trusted.
"""
