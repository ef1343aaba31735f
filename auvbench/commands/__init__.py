"""One short file per command, the only place that joins rooms together."""
