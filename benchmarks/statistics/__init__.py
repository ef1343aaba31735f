"""Measure how often intervals, letters and verdicts are right for simulated agents (`make statistics`).

The true values of simulated agents are known (`worlds`, `designs`). The code of reports computes the intervals and verdicts.
`python -m benchmarks.statistics` writes the tables into docs/statistics-appendix.md and docs/planning.md, each between two
markers.
"""
