# Everything a developer or a continuous-integration job runs. `make` alone prints the list.
PYTHON ?= python3
JOBS   ?= 2
VENV   := .venv
BIN    := $(VENV)/bin
# What users have, and what developers have besides.
FULL   := $(VENV)/.full
STAMP  := $(VENV)/.installed

# Figures are drawn without a display, whoever runs them.
export MPLBACKEND := Agg
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

# Modules are compiled when they are first imported: most never are, and compiling them all takes half a minute.
PIP     := $(BIN)/python -m pip install --no-compile --quiet --disable-pip-version-check -c constraints.txt
PYTEST  := $(BIN)/python -m pytest -n $(JOBS) --dist loadscope --no-loadscope-reorder --durations=10
SOURCES := src tests $(wildcard benchmarks examples)

.DEFAULT_GOAL := help
# Two installations into one environment at once would hurt each other.
.NOTPARALLEL:
.PHONY: help install demo test test-system test-all interpreters bench lint docs clean check-python system browser

help: ## print this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))
	@echo "  PYTHON=python3.12 picks the interpreter (3.11, 3.12 or 3.13), JOBS=4 the number of test processes."

install: $(STAMP) ## make .venv with the package and all extras, at the pinned versions

demo: $(FULL) ## run the demonstration
	$(BIN)/rovtwin demo

test: $(STAMP) ## run the tests of parts: none takes seconds
	$(PYTEST) -m "not slow and not system" $(ARGS)

test-system: $(STAMP) browser ## run the tests of the whole: flights, estimates, served vehicles, Chromium, MAVSDK, ROS
	$(PYTEST) -m "system and not slow" $(ARGS)

test-all: $(STAMP) browser ## run all tests, also those marked slow
	$(PYTEST) $(ARGS)

interpreters: $(STAMP) ## resolve the pins on every Python of 3.11, 3.12, 3.13 that is here, and smoke-test on the others
	$(BIN)/python tests/interpreters.py --jobs $(JOBS) $(ARGS)

bench: $(STAMP) ## run the benchmarks
	$(BIN)/python benchmarks/run.py $(ARGS)

lint: $(STAMP) ## check style, format, types and JavaScript
	@failed=; \
	for check in "ruff check" "ruff format --check --output-format=concise"; do \
	  echo "$$check"; $(BIN)/$$check --quiet $(SOURCES) || failed="$$failed [$$check]"; done; \
	echo oxlint; $(BIN)/oxlint --quiet --deny-warnings src tests || failed="$$failed [oxlint]"; \
	echo pyright; $(BIN)/pyright || failed="$$failed [pyright]"; \
	test -z "$$failed" || { echo "lint: failed:$$failed" >&2; exit 1; }

docs: $(STAMP) ## make pages of docs/ in build/docs
	@$(PIP) --no-build-isolation -e '.[docs]'
	@$(BIN)/sphinx-build -q -W --keep-going -b html docs build/docs
	@echo "rovtwin: open build/docs/index.html"

clean: ## remove .venv, caches, builds and runs
	rm -rf $(VENV) build dist runs .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Asks only when it matters: there is no .venv yet, or somebody names another Python than the one in it.
check-python:
	@if $(BIN)/python -c 'import pip' 2>/dev/null; then \
	  test "$(origin PYTHON)" = file && exit 0; \
	  have=$$($(BIN)/python -c 'import sys; print(*sys.version_info[:2], sep=".")'); \
	  want=$$("$(PYTHON)" -c 'import sys; print(*sys.version_info[:2], sep=".")'); \
	  test "$$have" = "$$want" && exit 0; \
	  echo "rovtwin: $(VENV) was made with Python $$have, you ask for '$(PYTHON)' ($$want): run 'make clean' first." >&2; exit 1; \
	fi; \
	command -v "$(PYTHON)" >/dev/null || { \
	  echo "rovtwin: '$(PYTHON)' was not found. Install Python 3.11, 3.12 or 3.13 (Debian, Ubuntu: apt install python3 python3-venv)" >&2; \
	  echo "         or say where it is: make PYTHON=/path/to/python3.12" >&2; exit 1; }; \
	"$(PYTHON)" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' || { \
	  echo "rovtwin: '$(PYTHON)' is $$("$(PYTHON)" --version 2>&1); rovtwin needs Python 3.11, 3.12 or 3.13." >&2; \
	  echo "         Install one (Debian, Ubuntu: apt install python3.12 python3.12-venv), then: make install PYTHON=python3.12" >&2; exit 1; }; \
	"$(PYTHON)" -c 'import venv, ensurepip' 2>/dev/null || { \
	  echo "rovtwin: '$(PYTHON)' comes without venv. Debian, Ubuntu: apt install python3-venv" >&2; exit 1; }

# OpenGL without a display, for pictures of scenes; without it a slower renderer without meshes takes its place.
system:
	@ldconfig -p 2>/dev/null | grep -q 'libEGL.so.1' && exit 0; \
	if test "$$(id -u)" = 0 && command -v apt-get >/dev/null; then \
	  echo "rovtwin: apt-get install libegl1 libgl1-mesa-dri, for OpenGL without a display (you are root)"; \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends libegl1 libgl1-mesa-dri; } >/dev/null 2>&1 && exit 0; \
	fi; \
	echo "rovtwin: no OpenGL over EGL here: scenes are drawn by the ray-caster, without meshes." >&2; \
	echo "         Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri" >&2

# The console's tests look at its pages in Debian's Chromium; without it they are skipped.
browser:
	@command -v chromium >/dev/null && exit 0; \
	if test "$$(id -u)" = 0 && command -v apt-get >/dev/null; then \
	  echo "rovtwin: apt-get install chromium, for the tests of the console (you are root)"; \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium; } >/dev/null 2>&1 && exit 0; \
	fi; \
	echo "rovtwin: no chromium here: the tests that look at the console's pages are skipped." >&2; \
	echo "         Debian: apt install chromium" >&2

# What builds packages goes in first, at its pinned version: ours with hatchling, what comes as source with setuptools.
$(FULL) $(STAMP): pyproject.toml constraints.txt | check-python
	@if ! $(BIN)/python -c 'import pip' 2>/dev/null; then \
	  echo "rovtwin: making $(VENV) with $$("$(PYTHON)" --version)"; rm -rf $(VENV); "$(PYTHON)" -m venv $(VENV); fi
	@echo "rovtwin: installing the package and its pinned dependencies into $(VENV) ($(if $(filter $(FULL),$@),1.8,2.4) GB on disk)"
	@$(MAKE) --no-print-directory system
	@$(PIP) hatchling editables setuptools
	@$(PIP) --no-build-isolation -e '.[$(if $(filter $(FULL),$@),full,all)]'
	@touch $@ $(if $(filter $(STAMP),$@),$(FULL))
	@echo "rovtwin: done; try $(BIN)/rovtwin --help"
