"""Studies: search an algorithm's settings on validation scenarios with Optuna; every trial is a run.

`space` reads what is searched, `strategy` names Optuna's samplers and pruners, `search` decides what to train next,
`journal` keeps it. `runs` makes a trial's run directories, `controller` has them carried out, `outcome` reads a study,
`preset` writes its best settings.
"""
