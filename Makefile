# Every target makes the environment it needs: on a fresh machine with Python 3.11 to 3.13, `make demo` and
# `make test` are all there is to type.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# What a user needs, and the developer's tools on top of it.
STAMP := $(VENV)/.installed
TOOLS := $(VENV)/.tools
PIP = $(BIN)/python -m pip install -qq --disable-pip-version-check
# One torch thread per process; tests run side by side on the cores there are.
JOBS ?= auto
PYTEST = $(BIN)/python -m pytest -n $(JOBS) --dist worksteal -q
export OMP_NUM_THREADS ?= 1
# Hundreds of test processes import the same modules: keep their bytecode.
unexport PYTHONDONTWRITEBYTECODE
# Without the theme's announcement of its successor.
# Not --quiet, which hides warnings from --strict too.
MKDOCS := NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
# SIGKILLs per case of `make soak`, power cuts of a training, flipped bits, faults of a pilot.
KILLS ?= 100
CUTS ?= 200
FLIPS ?= 2000
TRIALS ?= 3000
# Of `make fuzz`.
MINUTES ?= 60
# Simulated tables and experiments per row of `make statistics`.
REPLICATIONS ?= 500

.DEFAULT_GOAL := help
.PHONY: help install clone-path demo test test-slow check format lint type layers links docs bench statistics words house gallery verification parity soak fuzz lock release test-cluster test-programs clean

help: ## what there is to make
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1@/' | column -t -s @

install: $(STAMP) ## the virtual environment .venv with auvbench and MPC, without the developer's tools

$(STAMP): pyproject.toml constraints.txt requirements.lock requirements-build.lock
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if (3, 11) <= v < (3, 14) else \
	  f"auvbench needs Python 3.11 to 3.13, this is {v[0]}.{v[1]}; name another one: make $(MAKECMDGOALS) PYTHON=python3.12")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing into $(VENV) (torch and its friends: some minutes the first time)"
	@# Everything but PyTorch by the hashes of its files; the last line installs PyTorch, ourselves, and checks the rest.
	@$(PIP) --require-hashes --no-deps -r requirements-build.lock
	@$(PIP) --require-hashes --no-deps --no-build-isolation -r requirements.lock
	@$(PIP) --no-build-isolation -c constraints.txt -e '.[mpc]'
	@$(MAKE) -s clone-path
	@# The first step compiles the simulator for this machine: done here, no command has to wait for it.
	@$(BIN)/python -c 'import auvbench, gymnasium; e = gymnasium.make("auvbench/Waypoint-v0"); e.reset(); e.step(e.action_space.sample())'
	@touch $@

# From the folder that contains the clone, Python takes the clone for an empty package `auvbench`. A path to the clone has
# precedence over that; the finder of an editable installation has not.
SITE ?= $(shell $(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
clone-path:
	@echo '$(CURDIR)' > '$(SITE)/auvbench-clone.pth'

$(TOOLS): $(STAMP) requirements-dev.lock
	@echo "installing the developer's tools into $(VENV)"
	@$(PIP) --require-hashes --no-deps --no-build-isolation -r requirements-dev.lock
	@$(PIP) --no-build-isolation -c constraints.txt -e '.[dev]'
	@touch $@

demo: $(STAMP) ## train PPO with five seeds; test PID, MPC and PPO; rank them
	$(BIN)/auvbench train -m experiment=quickstart
	$(BIN)/auvbench evaluate outputs/quickstart protocol.episodes=25
	$(BIN)/auvbench report outputs/quickstart

test: $(TOOLS) ## the quick tests: what a contributor runs
	$(PYTEST) $(ARGS) -m "not slow"

test-slow: $(TOOLS) ## the tests that take seconds each: trainings, kills, virtual environments, browsers, ROS 2
	$(PYTEST) $(ARGS) -m slow

check: $(TOOLS) ## format, lint, types, layers, the links of the documentation
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

docs: $(TOOLS) ## the documentation as a site, site/index.html; a broken link or reference is an error
	$(MKDOCS)
	@echo "open site/index.html, or type $(BIN)/mkdocs serve"

format: $(TOOLS) ## rewrite the code in the house's format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(TOOLS) ## how fast everything is, as a table
	$(BIN)/python -m benchmarks $(ARGS)

statistics: $(TOOLS) ## measure anew how often reports are right: tables of docs/ (20 minutes of one core; a look: REPLICATIONS=20)
	$(BIN)/python -m benchmarks.statistics --replications $(REPLICATIONS) $(ARGS)

words: $(TOOLS) ## how plain the texts are: sentence length and patterns to avoid (ARGS="--sample 60" draws texts to read aloud)
	@$(BIN)/python -m benchmarks.words $(ARGS)

house: $(TOOLS) ## how the code is built: imports, names of integrations, reads by number (ARGS=--show lists them)
	@$(BIN)/python -m benchmarks.house $(ARGS)

gallery: $(TOOLS) ## the pictures of the documentation
	$(BIN)/python -m benchmarks.gallery

verification: $(TOOLS) ## compute docs/verification.md anew
	$(BIN)/python -m tests.verification.page

parity: $(TOOLS) ## the embedded simulator against Gazebo: tables of docs/parity.md (needs Gazebo)
	$(BIN)/python -m benchmarks.gazebo.parity

soak: $(TOOLS) ## kills, power cuts, flipped bits and faults of pilots for a long time
	$(BIN)/python -m tests.soak.results --cuts $(CUTS) --kills $(KILLS) --flips $(FLIPS) --seed $$(date +%s) --folder "$$(mktemp -d)"
	$(BIN)/python -m tests.soak.campaign --kills $(KILLS) --seed $$(date +%s) --folder "$$(mktemp -d)"
	$(BIN)/python -m tests.soak.tuning --kills $(KILLS) --seed $$(date +%s) --folder "$$(mktemp -d)"
	$(BIN)/python -m tests.soak.pilot --trials $(TRIALS) --seed $$(date +%s)

lock: $(TOOLS) ## the hashes of all files that an installation may take
	$(PIP) uv
	$(BIN)/python .ci/lock

release: ## sdist and wheel in dist/: built twice to the same bytes, tried in fresh environments; bill of materials in build/
	.ci/release

fuzz: $(TOOLS) ## random command lines, files and sheets for a long time (MINUTES=60)
	$(BIN)/python -m tests.fuzz.campaign --minutes $(MINUTES)

test-cluster: $(TOOLS) ## SLURM and Ray backends against real ones (installs them: root, Debian; ARGS="-k tuning" for some)
	tests/cluster/run.sh $(ARGS)

test-programs: $(TOOLS) ## other people's programs on the environments (installs some 20 GB; PROGRAMS=FOLDER keeps them)
	$(if $(PROGRAMS),AUVBENCH_PROGRAMS=$(abspath $(PROGRAMS))) $(BIN)/python -m pytest -q -m programs tests/programs

clean: ## remove the environment and caches, keep outputs
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis build site *.egg-info
