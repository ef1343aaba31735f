"""Reading what anybody may have written: run folders, sheets and configurations from a stranger, or a damaged disk.

Everything here is bounded (bytes, nesting, what an alias or an archive expands to) and raises a `ValueError` with
one line that says what is wrong; nothing runs code, and nothing follows a link out of a run. What is trusted and
what is not: SECURITY.md.
"""
