# Two commands do everything: make demo, make test. Both work with python3 and its venv module.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUT ?= results
RECORDS ?=# folders of CSV files that `make validate` fits beside simulated pads
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: demo test check bench validate notebooks docs dist clean

$(VENV)/installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .[dev]
	touch $@

demo: $(VENV)/installed
	$(BIN)/qlvbayes study data/pads.csv -o $(OUT)
	@echo "open $(OUT)/report.html in a browser"

test: $(VENV)/installed-dev
	$(PYTEST) -m "not slow"

check: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/installed-dev
	$(BIN)/python benchmarks/run.py

validate: $(VENV)/installed-dev
	$(PYTEST) -m slow
	$(BIN)/python validation/quoted.py
	$(BIN)/python validation/exported.py data/hidden.csv -o docs/exports.md
	$(BIN)/python validation/coverage.py --fits 80 --side-fits 0 --seed 1 -o docs/validation.md
	$(BIN)/python validation/ranks.py --fits 200 --broken jacobian --noise correlated
	$(BIN)/python validation/ranks.py --fits 200 --broken noise --noise correlated
	$(BIN)/python validation/ranks.py --fits 200 -o docs/validation.md
	$(BIN)/python validation/endurance.py kills --count 50
	$(BIN)/python validation/endurance.py inputs --count 100000
	$(BIN)/python validation/pairs.py --pairs 40 --seed 1 -o docs/pairs.md
	$(BIN)/python validation/adequacy.py --pads 300 --seed 1 -o docs/adequacy.md
	$(BIN)/python validation/budget.py $(RECORDS) --pads 100 --seed 418 -o docs/budget.md
	$(BIN)/python validation/modes.py --pads 100 --sets 20 --seed 303 -o docs/modes.md
	$(BIN)/python validation/wide.py rig --again --paper --studies 200 --seed 518

notebooks: $(VENV)/installed-dev
	$(BIN)/python notebooks/execute.py

docs: $(VENV)/installed-dev
	$(BIN)/python docs/building/stage.py

dist: $(VENV)/installed-dev
	$(BIN)/python -m build --outdir dist .

clean:
	rm -rf $(VENV) results build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
