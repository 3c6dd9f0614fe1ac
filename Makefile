# `make tables` and `make test` need Python 3.11 to 3.13, pip and this file; everything else they set up themselves.

PYTHON ?= $(firstword $(foreach v,3.12 3.11 3.13,$(shell command -v python$(v) 2>/dev/null)) $(shell command -v python3 2>/dev/null))
VENV := .venv
PY := $(VENV)/bin/python
PIP := $(PY) -m pip --disable-pip-version-check install --quiet -c constraints.txt
export PYTHONUNBUFFERED := 1

.PHONY: tables test check bench slow clean setup setup-test llvm

tables: setup llvm
	@$(VENV)/bin/radartwin tables --profile quick

test: setup-test llvm
	@$(PY) -m pytest -q

slow: setup-test llvm
	@$(PY) -m pytest -q -m "slow or gpu"

check: setup-test
	@$(PY) -m ruff check .
	@$(PY) -m ruff format --check .
	@$(PY) -m pyright

bench: setup llvm
	@$(PY) experiments/bench.py

clean:
	rm -rf $(VENV) outputs dist build .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

setup: $(VENV)/.ready
setup-test: $(VENV)/.ready-test

$(PY):
	@test -n "$(PYTHON)" || { echo "Python 3.11, 3.12 or 3.13 is needed and none was found; set PYTHON=/path/to/python3"; exit 2; }
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 13) else f"Python 3.11, 3.12 or 3.13 is needed; $(PYTHON) is {v[0]}.{v[1]}; set PYTHON=/path/to/python3")'
	@echo "setting up: virtual environment in $(VENV) ($(PYTHON))"
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.ready: $(PY) pyproject.toml constraints.txt
	@echo "setting up: pinned dependencies (about 1 GB, a minute or two)"
	@$(PIP) -e .
	@touch $@

$(VENV)/.ready-test: $(VENV)/.ready
	@echo "setting up: test dependencies"
	@$(PIP) -e '.[test]'
	@touch $@

llvm: setup
	@$(PY) -m radartwin.simulation.variant --ensure
