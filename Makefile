# Each target sets up what it needs; `make help` lists them.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
# Address of PyTorch's CPU wheels; empty takes pip's default, which on Linux brings CUDA along.
TORCH_INDEX ?=
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check --quiet
INSTALLED := $(VENV)/.installed
SMOKES := mujoco/sb3-ppo mujoco/rsl-ppo bullet/sb3-ppo bullet/rsl-ppo sapien/sb3-ppo sapien/rsl-ppo
export OMP_NUM_THREADS ?= 1

.PHONY: help install run test test-slow check smoke figures animation docs clean

help:
	@echo "make install    virtual environment with everything, in $(VENV)"
	@echo "make run        the main job: bench run --backend bullet --task eight (ARGS adds options)"
	@echo "make test       the tests, except slow ones"
	@echo "make test-slow  the slow tests"
	@echo "make check      format, lint, types"
	@echo "make smoke      one smoke run per engine and algorithm"
	@echo "make figures    the pictures in leaderboard/figures, and the leaderboard"
	@echo "make animation  the moving picture of the README, docs/images/hand.gif"
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

run: install
	$(VENV)/bin/bench run --backend bullet --task eight $(ARGS)

# A hang ends the run; no single test has a limit that a slow machine could exceed.
test: install
	timeout --kill-after=1m 80m $(VENV)/bin/python -m pytest -n 2 --dist worksteal -m "not slow" $(ARGS)

test-slow: install
	timeout --kill-after=1m 8h $(VENV)/bin/python -m pytest -n 2 --dist worksteal -m slow $(ARGS)

check: install
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

smoke: install $(addprefix smoke-run/,$(SMOKES))

smoke-run/%:
	$(VENV)/bin/bench run --smoke --force --backend $(*D) --algo $(*F) --task line --out runs/smoke/$(*D)-$(*F)

# The paper's figures, of policies in the repository.
DRAWN = line-s0-d7e7fc6e circle-s0-43bbd86c spiral-s0-1d1797ac eight-s0-94464651
figures: install $(addprefix figure/,$(DRAWN))
	for kind in joints touch hand; do $(VENV)/bin/bench view $(call POLICY,circle-s0-43bbd86c) \
		--kind $$kind --out leaderboard/figures/circle-$$kind.png || exit 1; done
	$(VENV)/bin/bench view --kind curve $(SEEN) --out leaderboard/figures/circle-observations.png
	$(VENV)/bin/bench view --kind curve $(LEARNT) --out leaderboard/figures/circle-learners.png
	$(VENV)/bin/bench leaderboard leaderboard/results

# What policies may see, three seeds each, on the reference.
CENTERS = s0-a1f0b803 s1-4fe6c557 s2-b5289021
LEAD = s0-bf32096a s1-2f5cede7 s2-ad71b955
SEEN = $(addprefix leaderboard/policies/mujoco-circle-sb3-ppo-contact-centers-,$(CENTERS)) \
	$(wildcard leaderboard/policies/mujoco-circle-sb3-ppo-pose*) \
	$(wildcard leaderboard/policies/mujoco-circle-sb3-ppo-raw-taxels-*) \
	$(addprefix leaderboard/policies/mujoco-circle-sb3-ppo-centers-and-lead-,$(LEAD))
# Both learners in every engine, three seeds each.
LEARNT = $(addprefix leaderboard/policies/mujoco-circle-sb3-ppo-contact-centers-,$(CENTERS)) \
	$(addprefix leaderboard/policies/bullet-circle-sb3-ppo-contact-centers-,s0-dcc5760e s1-cb4a162c s2-ee9cdd29) \
	$(addprefix leaderboard/policies/sapien-circle-sb3-ppo-contact-centers-,s0-2ff7fcd0 s1-f9f62a87 s2-bf278ae4) \
	$(wildcard leaderboard/policies/*-circle-rsl-ppo-contact-centers-*)
TASK = $(word 1,$(subst -, ,$(1)))
POLICY = leaderboard/policies/mujoco-$(TASK)-sb3-ppo-contact-centers$(patsubst $(TASK)%,%,$(1))
figure/%:
	$(VENV)/bin/bench view $(call POLICY,$*) --out leaderboard/figures/$(call TASK,$*).png

# Every warning is an error: a broken link, a missing picture, a page without a place in the menu.
docs: install
	$(VENV)/bin/python -m sphinx -W --keep-going -q -b html -d build/doctrees docs site
	@echo "docs: site/index.html"

# An eight on the reference, by a policy that draws it from the first lap on.
ANIMATED = leaderboard/policies/mujoco-eight-sb3-ppo-centers-and-lead-s2-b7396f4b
animation: install
	$(VENV)/bin/bench view $(ANIMATED) --out docs/images/hand.gif

clean:
	rm -rf $(VENV) site .mypy_cache .ruff_cache .pytest_cache
