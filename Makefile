# Each target sets up what it needs; `make help` lists them.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
# Address of PyTorch's CPU wheels; empty takes pip's default, which on Linux brings CUDA along.
TORCH_INDEX ?=
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check --quiet
INSTALLED := $(VENV)/.installed
# The default learner in every engine, and every other learner in the reference.
SMOKES := from benchmark.parts.registry import names, scripted, usual; \
	from benchmark.settings.run_spec import REFERENCE, RunSpec; \
	print(*(f"smoke-run/{engine}/{RunSpec.algo}" for engine in usual("backend")), \
	*(f"smoke-run/{REFERENCE}/{algo}" for algo in {*names("algo")} - {RunSpec.algo, *scripted()}))
export OMP_NUM_THREADS ?= 1

.PHONY: help install run demo test test-fast test-field test-slow check smoke results figures animation docs clean

help:
	@echo "make install    virtual environment with everything, in $(VENV)"
	@echo "make demo       bench demo: three engines, a film and a diagnosis in a minute, in demo/"
	@echo "make run        the main job: bench run --backend bullet --task eight (ARGS adds options)"
	@echo "make test       the tests, except slow ones"
	@echo "make test-fast  those of files, words, rows and floors, while one edits"
	@echo "make test-slow  the slow tests"
	@echo "make test-field robots and logs as people have them; those outside of the repository where found"
	@echo "make check      format, lint, types"
	@echo "make smoke      one smoke run per engine and learner"
	@echo "make results    every table and picture of README, docs and leaderboard, from what is kept"
	@echo "make figures    the pictures in which a policy is replayed, the README's too, then the results"
	@echo "make docs       the docs, as a site in site/"
	@echo "make clean      remove $(VENV) and caches"

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if v == (3, 11) else \
		f"Stickbench needs Python 3.11, the one version with wheels for every engine; this is {v}. Say PYTHON=/path/to/python3.11")'
	@echo "installing into $(VENV), some minutes ..."
	$(PYTHON) -m venv $(VENV)
	$(PIP) install -c constraints.txt torch $(if $(TORCH_INDEX),--index-url $(TORCH_INDEX))
	$(PIP) install -c constraints.txt -e '.[dev]'
	@touch $@

demo: install
	$(VENV)/bin/bench demo --force $(ARGS)

run: install
	$(VENV)/bin/bench run --backend bullet --task eight $(ARGS)

# A hang ends the run; no single test has a limit that a slow machine could exceed.
# A file's tests run on one core, which makes what they share once.
test: install
	timeout --kill-after=1m 80m $(VENV)/bin/python -m pytest -n 2 --dist loadscope -m "not slow" $(ARGS)

FAST := architecture bad_files docs log plain_yaml rows statistics words
test-fast: install
	timeout --kill-after=1m 80m $(VENV)/bin/python -m pytest -n 2 $(FAST:%=tests/unit/test_%.py) $(ARGS)

FIELD := drives field_cases importers joint_tables real_logs ros static two_files
test-slow: install
	timeout --kill-after=1m 8h $(VENV)/bin/python -m pytest -n 2 --dist worksteal -m slow $(ARGS)

test-field: install
	timeout --kill-after=1m 80m $(VENV)/bin/python -m pytest -n 2 --dist worksteal tests/field \
		$(FIELD:%=tests/unit/test_%.py) $(ARGS)

check: install
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

smoke: install
	$(MAKE) --no-print-directory $$($(VENV)/bin/python -c '$(SMOKES)')

smoke-run/%:
	$(VENV)/bin/bench run --smoke --force --backend $(*D) --algo $(*F) --task line --out runs/smoke/$(*D)-$(*F)

# Pictures that leaderboard/figures.yaml lists and that are stale.
figures animation: install
	$(VENV)/bin/python -m leaderboard.publish.figures
	$(VENV)/bin/python -m leaderboard.publish

results: install
	$(VENV)/bin/python -m leaderboard.publish

# Every warning is an error: a broken link, a missing picture, a page without a place in the menu.
docs: install
	$(VENV)/bin/python -m sphinx -W --keep-going -q -b html -d build/doctrees docs site
	@echo "docs: site/index.html"

clean:
	rm -rf $(VENV) site .mypy_cache .ruff_cache .pytest_cache
