#!/usr/bin/env bash
# Tests the SLURM and Ray backends against a real slurmctld, real slurmd and a real Ray on this machine.
# Installs what is missing: slurm-wlm from Debian (as root), Ray into an environment beside the project's own.
set -euo pipefail
cd "$(dirname "$0")/../.."
base=${VENV:-.venv}
venv=${CLUSTER_VENV:-.venv-cluster}

if ! command -v slurmctld >/dev/null; then
  apt-get update -qq
  apt-get install -y -qq --no-install-recommends slurm-wlm munge >/dev/null
fi

if ! [ -x "$venv/bin/python" ]; then
  "$base/bin/python" -m venv --without-pip "$venv"
  # Everything of the project's environment, its editable installation included, and Ray on top.
  "$base/bin/python" - "$venv" <<'PYTHON'
import site, sys, sysconfig
target = sysconfig.get_path("purelib", vars={"base": sys.argv[1], "platbase": sys.argv[1]})
folders = site.getsitepackages() + [path for path in sys.path if path.endswith("site-packages")]
with open(f"{target}/project.pth", "w") as file:
    file.writelines(f"import site; site.addsitedir({folder!r})\n" for folder in dict.fromkeys(folders))
PYTHON
fi
"$venv/bin/python" -c 'import ray' 2>/dev/null ||
  "$base/bin/python" -m pip --python "$venv/bin/python" install -q -c constraints.txt 'ray>=2.40'

echo "$(slurmctld -V), $("$venv/bin/python" -c '
import ray
print(f"ray {ray.__version__}")')"
AUVBENCH_CLUSTER=1 exec "$venv/bin/python" -m pytest tests/cluster -v --no-header --durations=0 --durations-min=5 "$@"
