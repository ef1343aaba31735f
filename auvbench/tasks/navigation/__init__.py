"""Navigation sensors and estimators (docs/navigation.md): each is a file with functions of one episode.

In these functions `e` is the record of an episode, `d` the record of its sensors and its estimate (`state.FIELDS`), `p` the parameters
(`state.parameters`).
"""
