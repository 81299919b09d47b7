# `make repro` sets up and runs the main job, `make test` sets up and runs the tests,
# `make proof` the tests that need many seeds, mutations or long fuzzing, `make docs` the site,
# `make pictures` the pictures of docs/ and README that show the fleet built last, and README's figures.
#   make repro FLEET=recorded RECORDINGS=path   runs it on real recordings

VENV := .venv
PYTHON ?= python3
BIN := $(VENV)/bin
export PATH := $(CURDIR)/$(BIN):$(PATH)
export PYTHONHASHSEED := 0
# each file is compiled once, not by each of the hundred processes of a build (containers often forbid it)
export PYTHONDONTWRITEBYTECODE :=
READY := $(VENV)/ready
TESTS := $(VENV)/ready-for-tests
PIP = $(BIN)/pip install --quiet --disable-pip-version-check -c requirements.lock
# uv where it is on the path; torch always by pip, whose configuration may name an index of CPU builds
INSTALL = $(if $(shell command -v uv),uv pip install --quiet --python $(BIN)/python -c requirements.lock,$(PIP))

.PHONY: repro test proof setup benchmark docs pictures clean

repro: $(READY)
ifdef FLEET
	kerf fleet $(FLEET) $(if $(RECORDINGS),--recordings "$(RECORDINGS)")
endif
	dvc repro

# a process a core, so one thread each: threads that wait for each other cost a quarter of the time
test proof: export OMP_NUM_THREADS := 1
test proof: export OPENBLAS_NUM_THREADS := 1

test: $(TESTS)
	ruff check .
	ruff format --check .
	mypy
	pytest -n auto --dist worksteal -m "not proof"

proof: $(TESTS)
	pytest -n auto --dist worksteal -m proof

benchmark: $(TESTS)
	pytest tests/benchmarks --benchmark-only -s

docs: $(TESTS)
	python docs/site/validation.py --check
	NO_MKDOCS_2_WARNING=1 mkdocs build --strict

pictures: $(TESTS)
	python docs/site/pictures.py
	python docs/site/validation.py

setup: $(TESTS)

$(READY): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 13) else f"Kerf needs Python 3.11 to 3.13, this is {v[0]}.{v[1]}: make PYTHON=/path/to/python3.11")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) "torch==$$(sed -n 's/^torch==//p' requirements.lock)"
	$(INSTALL) -e .
	kerf compile
	touch $@

$(TESTS): $(READY)
	$(INSTALL) -e ".[test,docs,stl,tdms,uff]"
	touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .hypothesis
