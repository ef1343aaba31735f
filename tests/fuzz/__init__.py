"""Random command lines, manifests, configurations, results and sheets: whatever comes, one line and no traceback.

`make test` tries a few examples of each; `make fuzz MINUTES=60` runs them for that long.
"""
