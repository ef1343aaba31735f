"""From run directories to what can be said: runs, agents, measures, the ranking, findings, studies.

`load` makes `RunRecord`s and `grouping` sections and agents of them; `ranking`, `findings` and `claims` say what
follows. Nothing is drawn here: `reporting` does that.
"""
