"""Studies: settings of an algorithm searched on validation scenarios, every trial a run like any other.

`space` reads what is searched, `samplers` propose a trial from what the trials before gave, `rungs` decide which
trials go on, `journal` keeps it all, `search` joins these; `runs` makes a trial's run directories, `controller` has
them carried out by a launcher; `outcome` reads a study again, `preset` writes what it found.
"""
