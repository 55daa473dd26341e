# Two commands set everything up: `make demo` and `make test`. They need Python 3.11 or newer and network access
# to Python's package index. `make test` also needs a few Debian packages (listed in `.ci/system-packages`): it asks
# before it installs them; `make system-packages` and CI do not ask.

PYTHON ?= python3
UV := $(shell command -v uv 2>/dev/null || echo $(CURDIR)/.tools/bin/uv)
BIN := .venv/bin
# Versions are pinned in requirements.lock; nothing is fetched that it does not name.
INSTALL = $(UV) pip install --quiet --python $(BIN)/python --build-constraints .ci/build.lock.txt

# A setting that keeps Python from storing compiled modules would cost each of the thousands of processes of the tests
# a second or more.
unexport PYTHONDONTWRITEBYTECODE

# The writer of the SBOM; it is run from an environment of its own.
CYCLONEDX := 7.5.0

.PHONY: system help demo demo-video test quick system-packages lint check coverage reference pictures lock docs dist release-check sbom clean fuzz hunt train-check
.DEFAULT_GOAL := demo

help: ## list what make can do
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 18

demo: .venv/.core ## the scale of a shipped scene: a table, and out/demo.png
	@mkdir -p out
	$(BIN)/estimate-scale data/scenes/demo_room --figure out/demo.png
	@echo "figure: out/demo.png; true scale: $$($(PYTHON) -c 'import json; print(json.load(open("data/scenes/demo_room/truth.json"))["metres_per_unit"])') metres per unit"

demo-video: .venv/.insert ## a shipped video: its reconstruction, its scale by its sensors, and an inserted object in out/demo_video.mp4
	@mkdir -p out
	$(BIN)/estimate-scale data/scenes/walk_carpark/video.mp4 --work out/walk_carpark --frames 30
	$(BIN)/insert-object out/walk_carpark --model data/models/rocking_horse.glb --size height=0.9 --facing 60 --at frame=150,x=390,y=350 --frames 110:170 --out out/demo_video.mp4
	@echo "video: out/demo_video.mp4; what it is of: data/scenes/walk_carpark/README.md"

test: system lint ## lint, types and all tests
	$(BIN)/python -m tests.run --types

# P is a package, or nothing for all of them.
P ?=
quick: check ## lint, types and the fast tests, of one package with P=estimator
	$(BIN)/python -m tests.run --quick tests/$(P)

system:
	@.ci/system-packages

system-packages: ## install the Debian packages of the tests without asking
	@YES=1 .ci/system-packages

check: lint ## lint and types
	$(BIN)/mypy

lint: .venv/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

hunt: .venv/.dev ## the property tests on new random examples
	HYPOTHESIS_PROFILE=hunt $(BIN)/python -m pytest -n 2 -m hypothesis

coverage: system .venv/.dev ## the tests with the share of lines and branches they run; 90 % is the floor
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --cov --cov-fail-under=90 --cov-report=term:skip-covered --cov-report=xml:out/coverage.xml

reference: .venv/.dev ## write the generated pages of the reference
	$(BIN)/python docs/generate.py
	$(BIN)/python docs/draw_architecture.py
	$(BIN)/python docs/module_index.py

pictures: .venv/.dev ## write the images of the documentation from the shipped scenes (three minutes)
	$(BIN)/python docs/draw_images.py

docs: | $(UV) ## build the documentation as a site, strict about links: out/docs
	NO_MKDOCS_2_WARNING=1 $(UV) tool run --quiet --python $(PYTHON) --with-requirements .ci/docs.lock.txt --from mkdocs mkdocs build --quiet
	@echo out/docs/index.html

lock: ## pin all dependencies again
	$(UV) pip compile --quiet --universal --generate-hashes --no-emit-index-url --no-header --extra all --group dev --no-emit-package metric-tree pyproject.toml -o requirements.lock
	$(UV) pip compile --quiet --universal --generate-hashes --no-emit-index-url --no-header --group docs -o .ci/docs.lock.txt

.venv/.core: pyproject.toml requirements.lock | $(BIN)/python
	$(INSTALL) --constraint requirements.lock --editable '.[scene]'
	@touch $@

.venv/.insert: pyproject.toml requirements.lock | $(BIN)/python
	$(INSTALL) --constraint requirements.lock --editable '.[insert]'
	@touch $@ .venv/.core

.venv/.dev: pyproject.toml requirements.lock | $(BIN)/python
	$(INSTALL) --requirement requirements.lock
	$(INSTALL) --no-deps --editable .
	@touch $@ .venv/.core .venv/.insert

$(BIN)/python: | $(UV)
	$(UV) venv --quiet --python $(PYTHON) .venv

$(CURDIR)/.tools/bin/uv:
	$(PYTHON) -m venv .tools
	.tools/bin/pip install --quiet --disable-pip-version-check --require-hashes --requirement .ci/uv.lock.txt

dist: | $(UV) ## build the wheel and the source archive; the same commit gives the same bytes
	rm -rf dist
	SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(UV) build --quiet --build-constraints .ci/build.lock.txt --require-hashes --out-dir dist
	@cd dist && sha256sum *.whl *.tar.gz

release-check: dist ## is what `make dist` writes fit to publish: versions, contents, the three programs from the wheel alone
	UV=$(UV) .ci/release-check

sbom: | $(UV) ## list all components of the full install (CycloneDX): out/sbom.json
	@mkdir -p out
	$(UV) tool run --quiet --from cyclonedx-bom==$(CYCLONEDX) cyclonedx-py requirements requirements.lock --pyproject pyproject.toml --output-reproducible --output-file out/sbom.json
	@echo out/sbom.json

clean: ## remove what make made
	rm -rf .venv .tools out .pytest_cache .mypy_cache .ruff_cache

# The training has an environment of its own, because torch needs 5.5 GB; TRAIN names another one.
TRAIN ?= out/train/venv/bin/python
train-check: .venv/.dev ## train a small detector on the CPU and estimate a scale with it (under 20 minutes on two cores)
	@mkdir -p out/train
	test -x $(TRAIN) || { $(UV) venv --quiet --python $(PYTHON) out/train/venv && $(UV) pip install --quiet --python $(TRAIN) '.[train]'; }
	rm -rf out/train/check
	$(BIN)/python -m benchmarks.train_check sets out/train/check
	$(BIN)/python -m benchmarks.train_check train out/train/check --python $(TRAIN)
	$(BIN)/python -m benchmarks.train_check scale out/train/check

# MINUTES for all of them together. Atheris has wheels for Linux.
MINUTES ?= 10
fuzz: .venv/.dev ## damaged input for every reader, guided by coverage
	$(UV) pip install --quiet --python $(BIN)/python --require-hashes --requirement .ci/fuzz.lock.txt
	$(BIN)/python -m tests.fuzz $(MINUTES)
