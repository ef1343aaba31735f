"""Solids in the water: positions, distances of points from solids, and intersections of rays with solids.

`solids` creates solids, `convex` and `terrain` have the geometry of one solid in the solid's own axes, and `casting` finds the nearest
of many solids. World axes are ENU in m: x east, y north, z up, the surface at z = 0. These modules do not use vehicles, tasks or the
configuration.
"""
