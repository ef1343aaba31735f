"""Random command lines, manifests, configurations, results and sheets: whatever comes, one line and no traceback.

`make test` runs each for seconds; `make fuzz MINUTES=60` runs them for as long as one likes.
"""
