"""These tests start real clusters: `make test-cluster` (tests/cluster/run.sh) runs them, `make test` does not."""

from __future__ import annotations

import os

collect_ignore_glob = [] if os.environ.get("AUVBENCH_CLUSTER") else ["test_*.py"]
