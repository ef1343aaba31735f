"""`make statistics`: how often intervals, letters and verdicts are right where the truth is known.

Agents are simulated whose true values are known (`worlds`); what a report would say of them is computed by the code
that reports use, and by the alternatives that were considered (`alternatives`). `python -m benchmarks.statistics` writes the
tables into docs/statistics-appendix.md and docs/planning.md, each between its two markers.
"""
