"""Run the command line when the package is started by `python -m auvbench`."""

import sys

from auvbench.cli import main

sys.exit(main())
