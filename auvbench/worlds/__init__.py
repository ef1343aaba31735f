"""Solids in the water: where they are, how far they are, and where a ray meets them.

`solids` makes them, `convex` and `terrain` are the geometry of one solid in its own axes, `casting` finds the nearest of many. World
axes are ENU in m: x east, y north, z up, the surface at z = 0. Nothing here knows vehicles, tasks or the configuration.
"""
