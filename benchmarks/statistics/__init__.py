"""`make statistics`: how often intervals, letters and verdicts are right where the truth is known.

Agents are simulated whose true values are known (`worlds`); what a report would say of them is computed by the code
that reports use, and by the alternatives that were considered (`alternatives`); whole studies are drawn and the claims of
the thesis judged by them (`studies`, `claims`). `python -m benchmarks.statistics` writes the tables into
docs/statistics.md, docs/claims-measured.md and docs/planning.md, each between its two markers.
"""
