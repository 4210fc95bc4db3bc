# Needs Python 3.11+, git and make; everything else is installed into .venv from the lock files.
PYTHON ?= python3
PART ?= vehicle
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=

.PHONY: help venv install uninstall demo test faults lint coverage mutation bench conformance lock clean

help:
	@echo "make demo [ARGS='--trajectory figure8']   fly a whole flight against the mocks"
	@echo "sudo make install [PART=vehicle|room|broker]   the service, for this computer; sudo make uninstall: docs/install.md"
	@echo "make test | faults | lint | coverage | mutation | bench | conformance | lock | clean"

# The stamp depends on the lock files: a changed lock is a new installation.
$(VENV)/.installed: requirements.lock requirements-dev.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed; '$(PYTHON)' is older. Say: make PYTHON=python3.12"; exit 1; }
	@echo "Installing into $(VENV) (once, about a minute) ..."
	@$(PYTHON) -m venv --clear $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-dev.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

venv: $(VENV)/.installed

# For the whole computer, with systemd; needs nothing of $(VENV).
install:
	@PYTHON='$(PYTHON)' sh systemd/install.sh $(PART) $(ARGS)

uninstall:
	@sh systemd/uninstall.sh $(ARGS)

demo: venv
	@$(BIN)/companion demo $(ARGS)

# Two processes: one for all that runs against the wall clock, the other, in what time that leaves, for the rest.
test: venv
	@$(BIN)/python -m tests $(ARGS)

faults: venv
	@$(BIN)/python -m tests.flights.faults $(ARGS)

lint: venv
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

# What keeps the vehicle safe is tested on every line and branch.
coverage: venv
	@$(BIN)/python -m coverage run -m pytest -q tests/supervisor tests/control/test_limits.py tests/control/test_guard.py tests/control/test_fence.py
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
	@$(BIN)/python -m pip install --quiet uv
	@$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" pyproject.toml -o requirements.lock
	@$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" --extra dev pyproject.toml -o requirements-dev.lock

clean:
	rm -rf $(VENV) *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
