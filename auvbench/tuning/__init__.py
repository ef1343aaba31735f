"""Studies: search an algorithm's settings on validation scenarios with Optuna; every trial is a run.

`space` reads what is searched, `search` decides what to train next. `runs` makes a trial's run directories, `controller` has
them carried out, `outcome` reads a study and writes its best settings.
"""
