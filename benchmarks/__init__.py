"""How fast auvbench is: `make bench`."""
