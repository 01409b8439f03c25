# Two commands do everything: make demo, make test. Both work with python3 and its venv module.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUT ?= results
FULL ?=# 1 for the published sizes of `make validate`
RECORDS ?=# folders of CSV files that `make validate` fits beside simulated pads
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: demo test test-integration check bench validate notebooks docs dist clean

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
	@cat $(VENV)/test-time 2>/dev/null || echo "make test: five to six minutes on two cores"
	@begin=$$(date +%s); $(PYTEST) -m "not slow and not integration" --durations=40; status=$$?; \
	echo "make test: the last run took $$((($$(date +%s) - begin) / 60 + 1)) minutes" > $(VENV)/test-time; \
	exit $$status

test-integration: $(VENV)/installed-dev
	$(PYTEST) -m "not slow and integration" --durations=20

check: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/installed-dev
	$(BIN)/python benchmarks/run.py

# the sizes of a run of two hours, and with FULL=1 those that docs/reliability.md publishes
size = $(if $(FULL),$(2),$(1))

validate: $(VENV)/installed-dev
	$(PYTEST) -m "slow or integration"
	$(BIN)/python validation/exported.py data/hidden.csv -o docs/exports.md
	$(BIN)/python validation/coverage.py --fits $(call size,40,80)
	$(BIN)/python validation/ranks.py --seed 2 --fits $(call size,40,200) --broken-fits $(call size,40,100)
	$(BIN)/python validation/pairs.py --pairs $(call size,20,40)
	$(BIN)/python validation/adequacy.py --pads $(call size,40,300)
	$(BIN)/python validation/budget.py $(RECORDS) --pads $(call size,6,54)
	$(BIN)/python validation/modes.py --pads $(call size,2,40) --sets $(call size,3,10)
	$(BIN)/python validation/endurance.py kills --count $(call size,10,50)
	$(BIN)/python validation/endurance.py inputs --count $(call size,1000,6500)
	$(BIN)/python validation/wide.py repeated --again --paper --seed 518 --studies $(call size,18,200) --note "the present version"
	$(BIN)/python validation/evidence.py --pads $(call size,10,100) --jobs 2
	$(BIN)/python validation/lifelike.py --studies $(call size,10,80) --seed 1141 --jobs 2 -o build/validation/lifelike
	$(BIN)/python validation/described.py --studies $(call size,14,140) --seed 2207 --jobs 2 -o build/validation/described
	$(BIN)/python validation/reliability.py

notebooks: $(VENV)/installed-dev
	$(BIN)/python notebooks/execute.py

docs: $(VENV)/installed-dev
	$(BIN)/python docs/building/stage.py

dist: $(VENV)/installed-dev
	$(BIN)/python -m build --outdir dist .

clean:
	rm -rf $(VENV) results build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
