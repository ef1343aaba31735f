"""Two contestants for auvbench: one that steers, one that learns."""
