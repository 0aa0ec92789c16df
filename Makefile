# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0

# make demo, make test: each sets up what it needs first. PYTHON=... chooses a Python.

VENV := .venv
FLOOR := .venv-floor
RELEASE := .venv-release
BIN := $(VENV)/bin
# A test that hangs fails, and says where; the longest needs a third of this on a loaded machine.
PYTEST := -m pytest -q --timeout=900
# A worker more than there are processors: those of the graph mostly wait. A file is one worker's;
# files go out in the order of test/conftest.py, not by their number of tests.
WORKERS = --numprocesses=$$(($$(nproc) + 1)) --dist=loadfile --no-loadscope-reorder

# What the environment is made from, and for which ROS; a change of either makes it again.
SOURCES := setup.py setup.cfg $(addprefix scripts/,setup.sh find_python.sh pip_install.sh slim.py)
READY := $(VENV)/ready-$(or $(ROS_DISTRO),wheels)
# What the demo needs; with it all that users can have; with that the tests.
ALL_READY := $(READY)-all
TEST_READY := $(READY)-test
FLOOR_READY := $(FLOOR)/ready
LINT_READY := $(READY)-lint
BENCH_READY := $(READY)-bench
DOCS_READY := $(READY)-docs
AUDIT_READY := $(READY)-audit

# An environment does not survive being moved: its stamp holds where it was made.
$(foreach stamp,$(READY) $(FLOOR_READY),$(if $(wildcard $(stamp)),\
	$(if $(filter $(CURDIR),$(shell cat $(stamp))),,$(shell rm -f $(stamp)))))

# Each of some hundred processes of the tests would compile all anew.
unexport PYTHONDONTWRITEBYTECODE
# As the nodes and the command set it themselves: idle threads of the matrix library spin, and
# threads add in another order each time.
export OPENBLAS_NUM_THREADS := 1
# On processors with AVX-512 NumPy takes one of two forms of arctan2, and of its like, by where in
# memory the result happens to lie: last digits would differ from run to run.
ifeq ($(shell uname -m),x86_64)
quick test coverage test-slow test-long test-late test-floor: export NPY_DISABLE_CPU_FEATURES := AVX512F AVX512_SKX X86_V4
endif

.DEFAULT_GOAL := help
.PHONY: help setup demo quick test test-slow test-long test-late test-all test-floor coverage lint types api docs audit bench check-arm64 fuzz planted-faults soak consistency smoothing real-flights states parameters reproduction release clean
.DELETE_ON_ERROR:

help:  ## this list
	@sed -n 's/^\([a-z0-9-]*\):.*## \(.*\)/make \1	\2/p' $(MAKEFILE_LIST) | expand -t 18

setup: $(ALL_READY)  ## ROS 2 Jazzy and all of tirgeo in .venv; then .venv/bin/tirgeo works
	@echo "ready: $(BIN)/tirgeo"

demo: $(READY)  ## the whole node graph on the sample flight; leaves a video in demo/
	$(BIN)/tirgeo demo

quick: $(TEST_READY)  ## the core's own quick tests: under a minute
	$(BIN)/python $(PYTEST) $(WORKERS) test/core

test: $(TEST_READY)  ## the tests, those of the running graph included: some minutes
	$(BIN)/python $(PYTEST) $(WORKERS) test

coverage: $(TEST_READY)  ## the tests but the long ones, and which branches they run; fails below its floors
	$(BIN)/coverage erase
	$(BIN)/coverage run $(PYTEST) $(WORKERS) test -m "not long"
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage json --quiet
	$(BIN)/python -m dev.coverage_floors build/coverage/report.json

test-slow: $(TEST_READY)  ## more: accuracy over many flights, large sets of pictures, recordings
	$(BIN)/python $(PYTEST) $(WORKERS) test -m "slow and not long"

test-long: $(TEST_READY)  ## what takes minutes of one kind, or wants a quiet machine
	$(BIN)/python $(PYTEST) $(WORKERS) test -m long

test-late: $(TEST_READY)  ## the page's tests with each press and message late: finds those that do not wait
	TIRGEO_LATE_MS=300 $(BIN)/python $(PYTEST) $(WORKERS) test/page/in_browser -m "not long"

test-all: test test-slow test-long  ## all three

# The packages that call these libraries: dji/ hardly does, nodes/ and dev/ need ROS.
test-floor: $(FLOOR_READY)  ## quick tests without ROS on the oldest NumPy, OpenCV and pyproj
	env -u ROS_DISTRO -u PYTHONPATH $(FLOOR)/bin/python $(PYTEST) $(WORKERS) test/core test/io test/tools -m "not graph and not slow" --hypothesis-profile=brief

lint: $(LINT_READY)  ## ruff: rules and format; shellcheck, actionlint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/shellcheck .ci/run scripts/*.sh
	$(BIN)/actionlint -shellcheck=$(BIN)/shellcheck .github/workflows/*.yml

types: $(LINT_READY)  ## mypy
	$(BIN)/mypy

api: $(DOCS_READY)  ## the reference of the Python interface in build/api, from the docstrings
	$(BIN)/python -m dev.api_reference build/api

# Symbolic links, so that the pages' links between folders lead somewhere on the site as well.
PAGES := $(wildcard *.md) CHANGELOG.rst Dockerfile LICENSE compose.yaml package.xml bags config docs examples test/packages.md

docs: api  ## the documents as a site in build/site, with search and the reference; links are checked
	rm -rf build/pages
	mkdir -p build/pages/test
	@$(foreach page,$(PAGES),ln -s $(CURDIR)/$(page) build/pages/$(page) &&) ln -s $(CURDIR)/build/api build/pages/reference
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "ready: build/site/index.html"

audit: $(AUDIT_READY)  ## known vulnerabilities of all installed packages, and their list as CycloneDX
	mkdir -p build
	$(BIN)/cyclonedx-py environment --output-reproducible --output-file build/tirgeo.cdx.json
	rm -f build/audit.json
	$(BIN)/pip-audit --local --skip-editable --progress-spinner off --format json --output build/audit.json 2>/dev/null || true
	$(BIN)/python -m dev.audit build/audit.json

bench: $(BENCH_READY)  ## speed of process, filter (beside pyins), overlay, graph and DJI's frames
	$(BIN)/python -m dev.bench

check-arm64: $(READY)  ## whether every dependency has a wheel for Linux on ARM64, by pip
	@$(BIN)/python -m dev.arm64_wheels

fuzz: $(ALL_READY)  ## 1e8 bytes of damage through the decoder of the serial link
	$(BIN)/python -m dev.fuzz

planted-faults: $(ALL_READY)  ## faults of set-up and sensors, and whether 'tirgeo check' names them
	$(BIN)/python -m dev.planted_faults bags/sample

MINUTES := 10

soak: $(ALL_READY)  ## the graph with kills, stops and jumps of the clock, ten minutes or MINUTES=60
	$(BIN)/python -m dev.soak --minutes $(MINUTES)

consistency: $(ALL_READY)  ## the filter's errors and its own sigmas over 60 simulated flights
	$(BIN)/python -m dev.consistency

FLIGHTS := ../shared/real_flights

real-flights: $(ALL_READY)  ## the filter over recorded flights, FLIGHTS=folder of bags
	@if [ -d "$(FLIGHTS)" ]; then \
		$(BIN)/python -m dev.real_flights "$(FLIGHTS)"; \
	else echo "skipped: there is no folder $(FLIGHTS); FLIGHTS=folder names one of bags"; fi

smoothing: $(ALL_READY)  ## the smoother beside the filter, also over FLIGHTS=folder of bags
	$(BIN)/python -m dev.smoothing $(wildcard $(FLIGHTS))

states: $(ALL_READY)  ## make the tracked states of the sample flight anew, after a meant change
	$(BIN)/python -m dev.state_table bags/sample test/data/sample_states.csv

parameters: $(READY)  ## docs/parameters.md, made of the parameters in tirgeo_ros/core/config
	$(BIN)/python -m dev.parameters_page docs/parameters.md

reproduction: $(ALL_READY)  ## docs/reproduction.md: runs the paper's tables anew, some ten minutes
	$(BIN)/python -m dev.reproduction

# Tools of its own: neither ROS nor the libraries are needed. TAG= is given where the tag exists.
release:  ## source distribution and wheel in dist/; refuses what is not ready for a release
	@python3 scripts/release.py $(TAG)
	rm -rf $(RELEASE) build dist
	python3 -m venv $(RELEASE)
	$(RELEASE)/bin/pip install --quiet --disable-pip-version-check build twine
	$(RELEASE)/bin/python -m build
	$(RELEASE)/bin/twine check --strict dist/*

clean:  ## remove what the above made, but for demo/
	rm -rf $(VENV) $(VENV).old $(FLOOR) $(FLOOR).old $(RELEASE) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): $(SOURCES)
	@scripts/setup.sh $(VENV) user
	@echo $(CURDIR) > $@

$(FLOOR_READY): $(SOURCES)
	@scripts/setup.sh $(FLOOR) floor
	@echo $(CURDIR) > $@

$(ALL_READY): $(READY)
	@scripts/pip_install.sh $(VENV) --editable ".[all]"
	@touch $@

$(TEST_READY): $(ALL_READY)
	@scripts/pip_install.sh $(VENV) --editable ".[test]"
	@touch $@

$(LINT_READY): $(TEST_READY)
	@scripts/pip_install.sh $(VENV) --editable ".[lint]"
	@touch $@

$(DOCS_READY): $(ALL_READY)
	@scripts/pip_install.sh $(VENV) --editable ".[docs]"
	@touch $@

$(AUDIT_READY): $(ALL_READY)
	@scripts/pip_install.sh $(VENV) --editable ".[audit]"
	@touch $@

$(BENCH_READY): $(ALL_READY)
	@scripts/pip_install.sh $(VENV) --editable ".[bench]" && touch $@ \
		|| echo "pyins could not be installed: the bench goes without it" >&2
