# Set-up and the main jobs. `make score` and `make test` work in a fresh clone: they make the virtual environment first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUNTIME := $(VENV)/.runtime-installed
LAV := $(VENV)/.lav-installed
DEV := $(VENV)/.dev-installed
DOCS := $(VENV)/.docs-installed

.PHONY: help score test test-slow lint bench docs wheel clean

help:
	@echo "make score      set up, then drive and score the bundled routes 'quick' with the LAV agent that ships"
	@echo "make test       set up, then ruff, mypy and the tests"
	@echo "make test-slow  the long tests"
	@echo "make bench      the speed of each part on this machine"
	@echo "make docs       the documentation as a site, in site/; warnings are errors"
	@echo "make wheel      wheel and source archive, checked, in dist/"
	@echo "make clean      remove the virtual environment, runs and caches"

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "Python 3.11 or newer is needed; name it with 'make PYTHON=python3.11 ...'." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

# A stamp is newer than pyproject.toml when what that file asks for is installed.
$(RUNTIME): pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(LAV): pyproject.toml $(RUNTIME)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[lav]'
	@touch $@

$(DEV): pyproject.toml $(RUNTIME)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,lav]'
	@touch $@

$(DOCS): pyproject.toml $(RUNTIME)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	@touch $@

score: $(LAV)
	$(BIN)/lavsim score --agent agents.lav:LavAgent --routes quick --out runs/score --overwrite

lint: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: lint
	$(BIN)/pytest -n 2 -m "not slow"

test-slow: $(DEV)
	$(BIN)/pytest -n 2 -m slow

bench: $(RUNTIME)
	$(BIN)/lavsim bench

docs: $(DOCS)
	$(BIN)/mkdocs build --strict

wheel: $(DOCS)
	rm -rf build dist
	$(BIN)/python -m build
	$(BIN)/twine check --strict dist/*

clean:
	rm -rf $(VENV) runs build dist site *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find lavsim leaderboard agents routes tests -name __pycache__ -type d -prune -exec rm -rf {} +
