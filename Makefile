# Bare `make` lists the targets. `make verify CASE=sen_shear TIER=paper` narrows a verification.

PYTHON ?= python3
CASE ?=
TIER ?= standard
JOBS ?= 2
OUT ?= reports/out
BIN := .venv/bin

.DEFAULT_GOAL := help
RECORD ?=
HISTORY ?=
MAP ?=

.PHONY: help install judge verify chapter4 charts test lint readme docs clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z0-9]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

install: .venv/developed ## make .venv with the pinned dependencies, the project and what its tests and lint need

# What is never imported is never compiled: --no-compile spares half of pip's processor time. What is imported is kept
# compiled, whatever the environment says: a process that compiles it anew starts in 3 s in place of 1 s.
unexport PYTHONDONTWRITEBYTECODE
PIP := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt

.venv/made: constraints.txt pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make install PYTHON=python3.12")'
	$(PYTHON) -m venv .venv
	@touch $@

# What judges results: the plain installation, without solvers.
.venv/light: .venv/made
	$(PIP) -e .
	@touch $@

.venv/installed: .venv/made
	$(PIP) -e '.[fast]'
	@touch $@ .venv/light

.venv/developed: .venv/made
	$(PIP) -e '.[dev]'
	@touch $@ .venv/light .venv/installed

judge: .venv/light ## judge a result of your own: CASE=, HISTORY= a CSV file, MAP= its columns, TIER=
	$(if $(and $(CASE),$(HISTORY)),,$(error make judge needs a case and a file: make judge CASE=sen_shear HISTORY=mine.csv))
	@$(BIN)/verify judge $(CASE) --history $(HISTORY) --map "$(MAP)" --tier $(TIER)

# A run that fails is judged too; only bad input (3) or anything unforeseen stops before the verdict.
verify: .venv/installed ## run, judge and report: CASE= (default all), TIER= quick | standard | paper, JOBS= at a time
	@$(BIN)/verify run $(CASE) --tier $(TIER) --out $(OUT) --jobs $(JOBS); ran=$$?; \
	if [ $$ran -ne 0 ] && [ $$ran -ne 2 ]; then exit $$ran; fi; \
	$(BIN)/verify compare $(CASE) --tier $(TIER) --out $(OUT) --jobs $(JOBS); verdict=$$?; \
	$(BIN)/verify report --out $(OUT) --jobs $(JOBS) || exit $$?; \
	if [ $$verdict -eq 0 ]; then exit $$ran; fi; exit $$verdict

chapter4: ## chapter 4's plates and panel at the thesis's resolution, both solvers: JOBS= at a time
	@$(MAKE) --no-print-directory verify TIER=paper CASE="sen_tension sen_shear l_panel plate_with_hole"

# A case without charts or maps at this tier says so (3) and the other is made.
charts: .venv/installed ## chart accuracy and map failure of CASE= at TIER=, and report; RECORD=1 records them, without CASE all
	$(if $(CASE)$(RECORD),,$(error make charts needs a case: make charts CASE=surfing, or RECORD=1 to record all of the library))
	@$(BIN)/verify chart $(CASE) --tier $(TIER) --out $(OUT) --jobs $(JOBS) $(if $(RECORD),--record); charted=$$?; \
	$(BIN)/verify stability $(CASE) --tier $(TIER) --out $(OUT) --jobs $(JOBS) $(if $(RECORD),--record); mapped=$$?; \
	if [ $$charted -ne 0 ] && [ $$mapped -ne 0 ]; then exit $$charted; fi; \
	$(if $(CASE),,exit $$((charted > mapped ? charted : mapped));) \
	$(BIN)/verify run $(CASE) --tier $(TIER) --out $(OUT) --jobs $(JOBS); \
	$(BIN)/verify compare $(CASE) --tier $(TIER) --out $(OUT) --jobs $(JOBS); \
	$(BIN)/verify report --out $(OUT) --jobs $(JOBS)

# The library first, whose two processes compile other kernels each: those of the tests would compile the same. Of a run
# that fails the tests tell.
test: .venv/developed ## run the tests
	-$(BIN)/verify run --tier quick --jobs 2 --out build/library
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --durations=20

lint: .venv/developed ## style, types and the import contract
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

readme: .venv/installed ## write the recorded times and ratios of docs/measured.toml into README.md
	$(BIN)/python -c 'from pathlib import Path; from reports.pages import write_marked; write_marked(Path("README.md"), Path("docs/measured.toml"))'

docs: .venv/light ## build the documentation site into build/docs/site
	$(PIP) -e '.[docs]'
	$(BIN)/python docs/site.py build/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict -f build/docs/mkdocs.yml

clean: ## remove the results, the virtual environment and all caches
	rm -rf .venv $(OUT) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
