# Two commands set everything up: `make demo` and `make test`. They need Python 3.11 or newer and network access
# to Python's package index; `make test` also asks for a few Debian packages (`.ci/system-packages` says which).

PYTHON ?= python3
UV := $(shell command -v uv 2>/dev/null || echo $(CURDIR)/.tools/bin/uv)
BIN := .venv/bin
# Versions are pinned in requirements.lock; nothing is fetched that it does not name.
INSTALL = $(UV) pip install --quiet --python $(BIN)/python

.PHONY: demo test check lock clean
.DEFAULT_GOAL := demo

demo: .venv/.core
	@mkdir -p out
	$(BIN)/estimate-scale data/scenes/demo_room --figure out/demo.png
	@echo "figure: out/demo.png; true scale: $$($(PYTHON) -c 'import json; print(json.load(open("data/scenes/demo_room/truth.json"))["metres_per_unit"])') metres per unit"

test: check
	$(BIN)/python -m pytest -n 2 --dist loadfile

check: .venv/.dev
	@.ci/system-packages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

lock:
	$(UV) pip compile --quiet --universal --generate-hashes --no-emit-index-url --no-header --all-extras --group dev --no-emit-package metric-tree pyproject.toml -o requirements.lock

.venv/.core: pyproject.toml requirements.lock | $(BIN)/python
	$(INSTALL) --constraint requirements.lock --editable .
	@touch $@

.venv/.dev: pyproject.toml requirements.lock | $(BIN)/python
	$(INSTALL) --requirement requirements.lock
	$(INSTALL) --no-deps --editable .
	@touch $@ .venv/.core

$(BIN)/python: | $(UV)
	$(UV) venv --quiet --python $(PYTHON) .venv

$(CURDIR)/.tools/bin/uv:
	$(PYTHON) -m venv .tools
	.tools/bin/pip install --quiet --disable-pip-version-check "uv>=0.9,<1"

clean:
	rm -rf .venv .tools out .pytest_cache .mypy_cache .ruff_cache
