"""Run `auvbench` as `python -m auvbench`."""

import sys

from auvbench.cli import main

sys.exit(main())
