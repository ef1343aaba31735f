"""Solids in the water: their positions, the distance of points from them, and where rays meet them.

`solids` creates solids, `convex` and `terrain` have the geometry of one solid in its own axes, and `casting` finds the nearest of many
solids. World axes are ENU in m: x east, y north, z up, the surface at z = 0. These modules do not use vehicles, tasks or the
configuration.
"""
