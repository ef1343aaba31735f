"""Search an algorithm's settings on validation scenarios with Optuna; every trial is a run.

`space` reads the search space and `search` decides what to train next. `runs` creates a trial's run
directories, `controller` schedules the runs, and `outcome` reads a study and writes its best settings.
"""
