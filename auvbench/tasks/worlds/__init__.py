"""Worlds: what is in the water of an episode.

`base` says what a world is, each other file is one, and `surroundings` has the solids of N episodes.
"""
