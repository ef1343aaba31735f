"""Range sensors: blocks of an observation that measure the solids of a world.

`base` has what all sensors share, each other file is one, and `installed` makes the sensors of a task.
"""
