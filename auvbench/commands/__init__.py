"""Commands: one short file each, which reads the command line and calls the other packages."""
