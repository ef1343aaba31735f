"""From run directories to what can be said: runs, agents, measures, the ranking, effects, findings, studies.

`load` makes `RunRecord`s and `grouping` agents of them; `ranking`, `effects`, `findings` and `study/` say what
follows. Nothing is drawn here: `reporting` does that.
"""
