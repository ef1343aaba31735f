# Every target installs what it needs: on a new machine with Python 3.11 to 3.13, `make demo` and `make test` work at once;
# with 3.14 `make demo`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# Marks of what is installed: auvbench for a user, and the developer's tools in addition.
STAMP := $(VENV)/.installed
TOOLS := $(VENV)/.tools
PIP = $(BIN)/python -m pip install --progress-bar off --root-user-action ignore --disable-pip-version-check
# Of pip's lines show the large files, as they come, and all after an error. The exit status is pip's, which a pipe would hide.
SHELL := bash
SHOWN = > >(awk '/(Downloading|Using cached) .* MB\)$$/ {file = $$(NF-2); sub(".*/", "", file); print "  " file, $$(NF-1), $$NF; fflush()} \
  /^Installing collected/ {print "  unpacking"; fflush()} /^ERROR/ {failed = 1} failed' >&2) 2>&1
# One torch thread per process; tests run in parallel on all cores, with one process more, since some tests wait.
JOBS ?= $(shell expr $$(getconf _NPROCESSORS_ONLN) + 1)
PYTEST = $(BIN)/python -m pytest -n $(JOBS) --dist worksteal -q
export OMP_NUM_THREADS ?= 1
# Keep bytecode, since hundreds of test processes import the same modules.
unexport PYTHONDONTWRITEBYTECODE
# Hide the theme's advertisement of its successor. --quiet would also hide warnings from --strict.
MKDOCS := NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
# Of `make soak`: SIGKILLs per case, power cuts of a training, flipped bits, and faults of a pilot.
KILLS ?= 100
CUTS ?= 200
FLIPS ?= 2000
TRIALS ?= 3000
# Duration of `make fuzz`.
MINUTES ?= 60
# Simulated tables and experiments per row of `make statistics`.
REPLICATIONS ?= 500

.DEFAULT_GOAL := help
.PHONY: help install clone-path demo test test-slow test-long check format lint type layers links docs bench statistics words house gallery verification parity soak fuzz lock release test-cluster test-programs clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1@/' | column -t -s @

install: $(STAMP) ## make the virtual environment .venv with auvbench and MPC, without the developer's tools

$(STAMP): pyproject.toml constraints.txt requirements.lock requirements-build.lock
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if (3, 11) <= v < (3, 15) else \
	  f"auvbench needs Python 3.11 to 3.14, this is {v[0]}.{v[1]}; choose another one: make $(MAKECMDGOALS) PYTHON=python3.12")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing into $(VENV) (PyTorch and others: some minutes the first time)"
	@# Hashes check all files but PyTorch's. The last command installs PyTorch and auvbench, and checks the versions.
	@$(PIP) --require-hashes --no-deps -r requirements-build.lock $(SHOWN)
	@$(PIP) --require-hashes --no-deps --no-build-isolation -r requirements.lock $(SHOWN)
	@$(PIP) --no-build-isolation -c constraints.txt -e '.[mpc]' $(SHOWN)
	@$(MAKE) -s clone-path
	@# The first step compiles the simulator for this machine, so that later commands do not wait for it.
	@$(BIN)/python -c 'import auvbench, gymnasium; e = gymnasium.make("auvbench/Waypoint-v1"); e.reset(); e.step(e.action_space.sample())'
	@touch $@

# In the folder that contains the clone, Python would import the clone as an empty package `auvbench`. A path to the clone takes
# precedence; the finder of an editable installation does not.
SITE ?= $(shell $(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
clone-path:
	@echo '$(CURDIR)' > '$(SITE)/auvbench-clone.pth'

$(TOOLS): $(STAMP) requirements-dev.lock
	@echo "installing the developer's tools into $(VENV)"
	@$(PIP) --require-hashes --no-deps --no-build-isolation -r requirements-dev.lock $(SHOWN)
	@$(PIP) --no-build-isolation -c constraints.txt -e '.[dev]' $(SHOWN)
	@touch $@

demo: $(STAMP) ## train PPO with five seeds; test PID, MPC and PPO; rank them
	$(BIN)/auvbench train -m experiment=quickstart
	$(BIN)/auvbench evaluate outputs/quickstart protocol.episodes=25
	$(BIN)/auvbench report outputs/quickstart

# .ci/run chooses all tests at once: each session imports, trains and compiles for its tests.
TESTS ?= not slow
test: $(TOOLS) ## run the quick tests, as before every commit
	$(PYTEST) $(ARGS) -m "$(TESTS)"

test-slow: $(TOOLS) ## run the tests that take seconds each: trainings, kills, virtual environments, browsers, ROS 2
	$(PYTEST) $(ARGS) -m "slow and not long"

test-long: $(TOOLS) ## run the tests that take half a minute or more each, and the commands of the documentation
	$(PYTEST) $(ARGS) -m long

check: $(TOOLS) ## check format, lint, types, layers and the links of the documentation
	@$(MAKE) --no-print-directory --jobs $(if $(filter output-sync,$(.FEATURES)),--output-sync=target) lint type layers links

lint: $(TOOLS)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

type: $(TOOLS)
	$(BIN)/mypy

layers: $(TOOLS)
	$(BIN)/lint-imports

links: $(TOOLS)
	site=$$(mktemp -d) && trap 'rm -rf "$$site"' EXIT && trap 'exit 130' INT TERM && $(MKDOCS) --site-dir "$$site"

docs: $(TOOLS) ## build the documentation, site/index.html; a broken link or reference is an error
	$(MKDOCS)
	@echo "open site/index.html, or type $(BIN)/mkdocs serve"

format: $(TOOLS) ## format the code
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(TOOLS) ## measure how fast auvbench is (ARGS=--write renews docs/performance.md)
	$(BIN)/python -m benchmarks $(ARGS)

statistics: $(TOOLS) ## measure how often verdicts are right, and renew the tables of docs/ (20 minutes of one core; a quick try: REPLICATIONS=20)
	$(BIN)/python -m benchmarks.statistics --replications $(REPLICATIONS) $(ARGS)

words: $(TOOLS) ## count long sentences and patterns to avoid in the texts (ARGS="--sample 60" draws texts to read aloud)
	@$(BIN)/python -m benchmarks.words $(ARGS)

house: $(TOOLS) ## count imports, names of integrations and array reads by number in the code (ARGS=--show lists them)
	@$(BIN)/python -m benchmarks.house $(ARGS)

gallery: $(TOOLS) ## draw the pictures of the documentation
	$(BIN)/python -m benchmarks.gallery

verification: $(TOOLS) ## compute docs/verification.md again
	$(BIN)/python -m tests.verification.page

parity: $(TOOLS) ## compare the embedded simulator with Gazebo, and renew the tables of docs/parity.md (needs Gazebo)
	$(BIN)/python -m benchmarks.gazebo.parity

soak: $(TOOLS) ## test kills, power cuts, flipped bits and faults of pilots for a long time
	$(BIN)/python -m tests.soak.results --cuts $(CUTS) --kills $(KILLS) --flips $(FLIPS) --seed $$(date +%s) --folder "$$(mktemp -d)"
	$(BIN)/python -m tests.soak.campaign --kills $(KILLS) --seed $$(date +%s) --folder "$$(mktemp -d)"
	$(BIN)/python -m tests.soak.tuning --kills $(KILLS) --seed $$(date +%s) --folder "$$(mktemp -d)"
	$(BIN)/python -m tests.soak.pilot --trials $(TRIALS) --seed $$(date +%s)
	AUVBENCH_KILLS=$(KILLS) $(BIN)/python -m pytest -q tests/integration/test_sweeps.py -k killed

lock: $(TOOLS) ## write the hashes of all files that an installation may use
	$(PIP) uv
	$(BIN)/python .ci/lock

release: ## build sdist and wheel in dist/ twice, compare their bytes, try them in new environments; write a bill of materials to build/
	.ci/release

fuzz: $(TOOLS) ## test random command lines, files and sheets for a long time (MINUTES=60)
	$(BIN)/python -m tests.fuzz.campaign --minutes $(MINUTES)

test-cluster: $(TOOLS) ## test the launchers with a real SLURM and a real Ray (installs them: root, Debian; ARGS="-k tuning" selects tests)
	tests/cluster/run.sh $(ARGS)

test-programs: $(TOOLS) ## test other people's programs with the environments (installs about 20 GB; PROGRAMS=FOLDER keeps them)
	$(if $(PROGRAMS),AUVBENCH_PROGRAMS=$(abspath $(PROGRAMS))) $(BIN)/python -m pytest -q -m programs tests/programs

clean: ## remove the environment and caches; outputs/ stays
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis build site *.egg-info
