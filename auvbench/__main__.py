"""`python -m auvbench` is `auvbench`."""

import sys

from auvbench.cli import main

sys.exit(main())
