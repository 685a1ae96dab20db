# Each target sets up what it needs in .venv: make and Python 3.11 or newer are enough.
#   make prove ONLY=name      the proofs whose name holds it
#   make prove PART=2/4       the second quarter of the proofs that measure no time
#   make fuzz COUNT=200000    more damaged files
#   make test PYTHON=python3.12
#   make demo OPEN=0          a gallery of files, and no browser

ENVIRONMENT := .venv
BIN := $(ENVIRONMENT)/bin
RECENT := import sys; sys.exit(sys.version_info < (3, 11))
PYTHON ?= $(shell for python in python3.13 python3.12 python3.11 python3; do \
	$$python -c '$(RECENT)' 2>/dev/null && echo $$python && break; done)
INSTALL = $(BIN)/python -m pip install --quiet --constraint constraints.txt
ONLY ?=
PART ?=
OPEN ?=
COUNT ?= 50000
# With ONLY, a run may hold no test: pytest then says 5.
FEW = $(if $(ONLY),|| test $$? -eq 5)
# Dozens of tests start struck anew: what Python has once compiled, none of them compiles again.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help demo test prove fuzz check bench docs wheels clean

help:  ## List the targets
	@sed -n 's/^\([a-z]*\):.*## /make \1\t/p' $(MAKEFILE_LIST) | expand -t 14

demo: $(ENVIRONMENT)/all.stamp  ## Open the room of objects; without a display, or OPEN=0, the gallery
	$(BIN)/struck demo --out gallery $(if $(filter 0,$(OPEN)),,--open)

test: $(ENVIRONMENT)/test.stamp  ## A sample of every promise
	$(BIN)/python -m pytest --numprocesses 2

prove: $(ENVIRONMENT)/test.stamp  ## Every promise in full; ONLY=name, PART=k/4 for some
	$(BIN)/python -m pytest -m "prove and not timed" $(if $(PART),--part "$(PART)") $(if $(ONLY),-k "$(ONLY)") --numprocesses 2 $(FEW)
	$(if $(PART),,$(BIN)/python -m pytest -m "prove and timed" $(if $(ONLY),-k "$(ONLY)") $(FEW))

fuzz: $(ENVIRONMENT)/test.stamp  ## 50,000 damaged files of every format, COUNT=n; failures go to tests/fuzz/corpus
	$(BIN)/python -m tests.fuzz.run --count $(COUNT)

check: $(ENVIRONMENT)/lint.stamp  ## Style, types, layers, dead code, wording; a report of sizes
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports
	$(BIN)/vulture src $$(find src -name '*.pyi')
	$(BIN)/python .ci/plain.py
	$(BIN)/python .ci/heads.py
	$(BIN)/python .ci/sizes.py

bench: $(ENVIRONMENT)/all.stamp  ## Ratios against peers
	$(BIN)/python bench/starting.py
	$(BIN)/python bench/reading.py
	$(BIN)/python bench/solids.py
	$(BIN)/python bench/meshing.py
	$(BIN)/python bench/everyday.py --only mug,glass,table --accuracy standard
	$(BIN)/python bench/synthesis.py
	$(BIN)/python bench/ears.py
	$(BIN)/python bench/scenes.py
	$(BIN)/python bench/touch.py
	$(BIN)/python bench/page.py
	$(BIN)/python bench/chimes.py
	$(BIN)/python bench/shapes.py
	$(BIN)/python bench/fitting.py
	$(BIN)/python bench/batch.py

docs: $(ENVIRONMENT)/docs.stamp  ## The documentation as pages in docs/_build
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build

wheels: $(ENVIRONMENT)/build.stamp  ## Wheels of five platforms, in dist
	for platform in linux-x86_64 linux-aarch64 macos-x86_64 macos-arm64 windows-x86_64; do \
		STRUCK_PLATFORM=$$platform $(BIN)/python -m hatchling build -t wheel -d dist || exit 1; done

clean:  ## Remove everything that make made, the environment too
	rm -rf $(ENVIRONMENT) gallery docs/_build docs/gallery docs/static/sounds dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache

$(ENVIRONMENT)/pip.stamp:
	@$(or $(PYTHON),false) -c '$(RECENT)' || \
		{ echo "struck needs Python 3.11 or newer, found $(or $(PYTHON),none): name one, as in make PYTHON=python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(ENVIRONMENT)
	$(INSTALL) --upgrade pip
	@touch $@

# all.stamp: struck with every extra; NAME.stamp: the dependency group NAME on top
# Compiled again when a source of the core has changed.
CORE := hatch_build.py $(wildcard src/struck/core/*.[ch]) src/struck/core/build.py

$(ENVIRONMENT)/all.stamp: $(ENVIRONMENT)/pip.stamp pyproject.toml constraints.txt $(CORE)
	$(INSTALL) --build-constraint constraints.txt --editable '.[all]'
	@touch $@

$(ENVIRONMENT)/%.stamp: $(ENVIRONMENT)/all.stamp
	$(INSTALL) --group $*
	@touch $@
