# `make tables` and `make test` need Python 3.11 to 3.13 and pip. They install everything else themselves.

VENV := .venv
COMMA := ,
PY := $(VENV)/bin/python
# Python compiles the modules of the packages when it first imports them. Compiling all modules here would double the time.
export PYTHONDONTWRITEBYTECODE :=
PIP := $(PY) -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
# uv installs the wheels that pip would install, in a fifth of the processor time. It gets the package indexes from the settings of pip. If
# uv fails, pip installs everything.
define INSTALL
@settings="$$($(PY) -m pip --disable-pip-version-check config list)"; \
  setting() { printf '%s\n' "$$settings" | sed -n "s/^[^=]*[.]$$1='\(.*\)'$$/\1/p" | sed 's/\\n/ /g' | tr '\n' ' '; }; \
  option() { for value in $$(setting $$1); do printf -- '--%s %s ' $$2 "$$value"; done; }; \
  { test -z "$$(setting no-index)" && $(PIP) uv && $(PY) -m uv pip install --quiet --python $(PY) --index-strategy unsafe-best-match \
    $$(option index-url default-index) $$(option extra-index-url index) $$(option find-links find-links) -c constraints.txt -e $(1); } \
  || $(PIP) -e $(1)
endef
SUPPORTED := import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))
export PYTHONUNBUFFERED := 1

.NOTPARALLEL:
.PHONY: tables test net slow check coverage bench mutants docs test-slurm clean setup setup-test llvm

tables: setup
	@$(VENV)/bin/radartwin tables --profile quick

test: setup-test setup
	@$(PY) -m pytest -q -n 2 --dist worksteal

# What no change of structure may change: fixed simulations and rows of tables to 1e-9, the verbs, and the refusals.
net: setup-test llvm
	@$(PY) -m pytest -q -n 2 -m "net or not slow and not gpu" tests/net tests/end_to_end/test_cli.py tests/end_to_end/test_cli_mistakes.py

slow: setup-test llvm
	@$(PY) -m pytest -q -m "slow or gpu"

check: setup-test
	@$(PY) -m ruff check .
	@$(PY) -m ruff format --check .
	@$(PY) -m pyright
	@$(PY) -m pytest -q tests/contract/test_imports.py

# Run the ordinary tests and measure branch coverage, also in the processes that they start. The report is in outputs/coverage/html.
coverage: setup-test llvm
	@mkdir -p outputs/coverage && $(PY) -m coverage erase
	@$(PY) -m coverage run -m pytest -q -n 2 --dist worksteal
	@$(PY) -m coverage combine --quiet && $(PY) -m coverage html --quiet && $(PY) -m coverage report

# Run the SLURM tests on a real SLURM of one node in a temporary folder. The installed packages start no system service.
test-slurm: setup-test
	@command -v slurmctld >/dev/null || test -x /usr/sbin/slurmctld || \
	  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends slurm-wlm munge; }
	@$(PY) -m pytest -q -m slow tests/slurm

# Insert faults into the physics code, one at a time in a copy of the repository. The quick physics tests must detect each fault.
mutants: setup-test llvm
	@$(PY) tests/mutants/plant.py

# Build the documentation site with the executed tutorial and the reference, in build/docs.
docs: setup-test llvm
	@$(PY) docs/site/build_site.py

bench: llvm
	@$(PY) -m experiments.speed.bench --history
	@if nvidia-smi >/dev/null 2>&1; then $(PY) -m experiments.speed.bench --history --variant cuda; fi

# Keep the folder outputs, which may hold recordings and hours of results.
clean:
	rm -rf $(VENV) dist build .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Install everything that the radartwin command needs in a checkout, and nothing more. Compile the simulator ahead of its first use.
setup: llvm $(VENV)/.compiled
setup-test: $(VENV)/.ready-test

llvm: $(VENV)/.ready
	@$(PY) -m radartwin.simulation.variant --ensure

# One call of pip installs both groups, because each call takes over ten seconds to find that nothing is missing.
$(VENV)/.ready-test: $(PY) pyproject.toml constraints.txt
	@echo "setting up: pinned dependencies with those of the tests, about 1 GB, one to three minutes"
	$(call INSTALL,'.[study$(COMMA)test]')
	@touch $(VENV)/.ready $@

# Compile again after a change of the source code (84 s of processor time, 1.4 s if nothing has changed; 2026-11-29), and before the tests
# start: otherwise their processes wait for each other's compilers. Numba takes longer if it colours its error messages.
$(VENV)/.compiled: $(VENV)/.ready $(shell find radartwin -name '*.py')
	@echo "setting up: compiling the simulator, one to two minutes the first time"
	@NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING=1 $(PY) -m radartwin.simulation.compile_ahead
	@touch $@

$(VENV)/.ready: $(PY) pyproject.toml constraints.txt
	@echo "setting up: pinned dependencies, about 1 GB, one to three minutes"
	$(call INSTALL,'.[study]')
	@touch $@

# Use the first Python that runs and has a supported version. A name on the PATH may be a shim of a version that is not installed.
$(PY):
	@for python in $(PYTHON) python3.12 python3.11 python3.13 python3; do \
	  if "$$python" -c '$(SUPPORTED)' >/dev/null 2>&1; then \
	    echo "setting up: $(VENV) with $$("$$python" --version)"; \
	    "$$python" -m venv $(VENV) && exit 0; \
	    rm -rf $(VENV); \
	    echo "this Python cannot make virtual environments; on Debian or Ubuntu: apt-get install python3-venv"; exit 2; \
	  fi; \
	done; \
	echo "Python 3.11, 3.12 or 3.13 is needed and none was found; try make PYTHON=/path/to/python3 $(MAKECMDGOALS)"; exit 2
