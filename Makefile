# Needs Python 3.11+, git and make; everything else is installed into .venv from the lock files.
PYTHON ?= python3
PART ?= vehicle
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
UV := $(BIN)/uv pip install --quiet --system-certs --compile-bytecode --python $(BIN)/python

.PHONY: help venv install uninstall demo check quick test faults fuzz lint coverage mutation bench conformance lock wheels clean

help:
	@echo "make demo [ARGS='--trajectory figure8']   fly a whole flight against the mocks"
	@echo "sudo make install [PART=vehicle|room|broker|law]   the service, for this computer; sudo make uninstall: docs/install.md"
	@echo "make test     all tests;   make check     the quick ones and lint, for the daily loop"
	@echo "make fuzz [ARGS='--minutes 30']   property tests on new random examples"
	@echo "make faults | lint | coverage | mutation | bench | conformance | lock | wheels | clean"

# The stamp depends on the lock files: a changed lock is a new installation. uv takes seconds; where it cannot be had, or
# cannot reach the package index that pip is set up for, pip does the same from the same lock.
$(VENV)/.installed: requirements-dev.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed; '$(PYTHON)' is older or missing. Say: make PYTHON=python3.12"; exit 1; }
	@echo "Installing into $(VENV) (once; some seconds, without uv a minute) ..."
	@$(PYTHON) -m venv --clear $(VENV) || { echo "'$(PYTHON) -m venv' failed; on Debian and Ubuntu it comes with: sudo apt-get install python3-venv"; exit 1; }
	@awk '/^[^ #]/ { take = /^uv==/ } take' requirements-dev.lock > $(VENV)/uv.lock
	@{ $(PIP) --require-hashes -r $(VENV)/uv.lock && $(UV) --require-hashes -r requirements-dev.lock && $(UV) --no-deps --no-build-isolation -e .; } > $(VENV)/uv.log 2>&1 \
	  || { echo "uv did not do it ($(VENV)/uv.log says why); now with pip"; $(PIP) --require-hashes -r requirements-dev.lock && $(PIP) --no-deps --no-build-isolation -e .; }
	@$(BIN)/python -m compileall -q companion mock_autopilot tests
	@touch $@

# The law's compiled twin; without a C compiler everything works, slower.
$(VENV)/.compiled: $(VENV)/.installed $(wildcard companion/compiled/*.[ch]) companion/compiled/library.py
	@$(BIN)/python -m companion.compiled.library
	@touch $@

venv: $(VENV)/.installed $(VENV)/.compiled

# For computers without a C compiler, with the compiled law in them.
wheels: venv
	@$(BIN)/python -m companion.compiled.wheels $(ARGS)

# For the whole computer, with systemd; needs nothing of $(VENV).
install:
	@PYTHON='$(PYTHON)' sh systemd/install.sh $(PART) $(ARGS)

uninstall:
	@sh systemd/uninstall.sh $(ARGS)

demo: venv
	@$(BIN)/companion demo $(ARGS)

# What runs against the wall clock first; all else in the time that it leaves (tests/__main__.py).
test: venv
	@$(BIN)/python -m tests $(ARGS)

# For the daily loop: lint, types, and the tests that neither wait nor fly for long.
check: venv
	@$(MAKE) --no-print-directory -j2 --output-sync=target lint quick

quick: venv
	@$(BIN)/python -m pytest -q -n logical --dist loadfile -m "not realtime and not slow" $(ARGS)

fuzz: venv
	@$(BIN)/python -m tests.fuzz $(ARGS)

faults: venv
	@$(BIN)/python -m tests.flights.faults $(ARGS)

lint: venv
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python -m companion.simulation.traces --check

# What keeps the vehicle safe is tested on every line and branch; `make test` asks that, too.
coverage: venv
	@HYPOTHESIS_PROFILE=few $(BIN)/python -m coverage run -m pytest -q tests/supervisor tests/guard
	@$(BIN)/python -m coverage report

# Changes that code in a thousand ways and sees whether a test notices; an hour. docs/mutation.md has the last result.
mutation: venv
	@$(BIN)/mutmut run
	@$(BIN)/mutmut export-cicd-stats
	@$(BIN)/python -c 'import json; s = json.load(open("mutants/mutmut-cicd-stats.json")); k = s["killed"] + s["timeout"]; print(f"{k} of {s[\"total\"]} killed"); raise SystemExit(k < 0.95 * s["total"])'

bench: venv
	@$(BIN)/python -m benchmarks $(ARGS)

conformance: venv
	@$(BIN)/python -m tests.mock_autopilot.conformance

lock: venv
	@$(BIN)/uv pip compile --quiet --universal --fork-strategy fewest --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" pyproject.toml -o requirements.lock
	@$(BIN)/uv pip compile --quiet --universal --fork-strategy fewest --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" --extra dev --extra cluster pyproject.toml -o requirements-dev.lock

clean:
	rm -rf $(VENV) *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
