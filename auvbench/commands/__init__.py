"""One short file per command: reads the command line and calls the other packages."""
