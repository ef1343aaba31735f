"""Measure how fast auvbench is (`make bench`), and draw the pictures of docs/."""
