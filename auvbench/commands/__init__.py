"""Commands: each has one short file, which reads the command line and calls the packages that do the work."""
