"""auvbench: which controller tracks waypoints best on an autonomous underwater vehicle, and how sure are we?"""

__version__ = "0.1.0"
