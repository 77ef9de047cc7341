# make demo   scripted and learned policies in one table, a figure and report.html, from a fresh clone, in a few minutes
# make test   lint, types and tests
# make bench  speed and memory
# make reproduce   the papers' experiments in full (EPISODES=24 for a look)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet --constraint constraints.txt
EPISODES ?= 200

.PHONY: demo test lint reproduce bench clean

demo: $(VENV)/run.stamp
	$(BIN)/osl bench demo

test: $(VENV)/test.stamp lint
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile

lint: $(VENV)/test.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

reproduce: $(VENV)/run.stamp
	$(BIN)/osl reproduce muc-osl all --episodes $(EPISODES)
	$(BIN)/osl reproduce chemotaxis all
	$(BIN)/osl reproduce gaslam all
	$(BIN)/osl reproduce swarm all

bench: $(VENV)/test.stamp
	$(BIN)/python -m pytest tests/benchmarks --benchmark-only --benchmark-columns=min,median,ops
	$(BIN)/python tests/benchmarks/compare.py

clean:
	rm -rf $(VENV) build dist results .pytest_cache .mypy_cache .ruff_cache .benchmarks .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# a stamp is newer than the files that say what to install: nothing is installed twice
$(VENV)/python.stamp:
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/run.stamp: $(VENV)/python.stamp pyproject.toml constraints.txt
	$(PIP) --editable .
	touch $@

$(VENV)/test.stamp: $(VENV)/python.stamp pyproject.toml constraints.txt
	$(PIP) --editable ".[dev,train]"
	touch $@ $(VENV)/run.stamp
