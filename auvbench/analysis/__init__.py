"""Analyse run directories: runs, agents, measures, ranking, findings, studies.

`load` reads `RunRecord`s, and `grouping` forms sections and agents; `ranking`, `findings` and `claims` draw
conclusions. `reporting` draws figures and tables.
"""
