# make demo, make test: each sets up what it needs first. PYTHON=... chooses a Python.

VENV := .venv
FLOOR := .venv-floor
BIN := $(VENV)/bin
PYTEST := -m pytest -q

# What the environment is made from, and for which ROS; a change of either makes it again.
SOURCES := setup.py setup.cfg scripts/setup.sh scripts/find_python.sh
READY := $(VENV)/ready-$(or $(ROS_DISTRO),wheels)
FLOOR_READY := $(FLOOR)/ready
LINT_READY := $(READY)-lint
BENCH_READY := $(READY)-bench

# An environment does not survive being moved: its stamp holds where it was made.
$(foreach stamp,$(READY) $(FLOOR_READY),$(if $(wildcard $(stamp)),\
	$(if $(filter $(CURDIR),$(shell cat $(stamp))),,$(shell rm -f $(stamp)))))

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-floor lint types bench fuzz consistency states reproduction clean
.DELETE_ON_ERROR:

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1	\2/p' $(MAKEFILE_LIST) | expand -t 18

setup: $(READY)  ## ROS 2 Jazzy and tirgeo in .venv; then .venv/bin/tirgeo works
	@echo "ready: $(BIN)/tirgeo"

demo: $(READY)  ## the whole node graph on the sample flight; leaves a video in demo/
	$(BIN)/tirgeo demo

test: $(READY)  ## all tests, those of the running graph included
	$(BIN)/python $(PYTEST)

test-floor: $(FLOOR_READY)  ## quick tests without ROS on the oldest NumPy, OpenCV and pyproj
	env -u ROS_DISTRO -u PYTHONPATH $(FLOOR)/bin/python $(PYTEST) --ignore=test/nodes -m "not graph and not slow" --hypothesis-profile=brief

lint: $(LINT_READY)  ## ruff: rules and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(LINT_READY)  ## mypy
	$(BIN)/mypy

# As the nodes and the command set it themselves: idle threads of the matrix library spin.
bench: $(BENCH_READY)  ## speed of process, filter (beside pyins), overlay, graph and DJI's frames
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tirgeo_ros.tools.bench

fuzz: $(READY)  ## 1e8 bytes of damage through the decoder of the serial link
	$(BIN)/python -m tirgeo_ros.tools.fuzz

consistency: $(READY)  ## the filter's errors and its own sigmas over 60 simulated flights
	$(BIN)/python -m tirgeo_ros.tools.consistency

states: $(READY)  ## make the tracked states of the sample flight anew, after a meant change
	$(BIN)/python -m tirgeo_ros.tools.states bags/sample test/data/sample_states.csv

reproduction: $(READY)  ## docs/reproduction.md: runs the paper's tables anew, some ten minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tirgeo_ros.tools.reproduction

clean:  ## remove what the above made, but for demo/
	rm -rf $(VENV) $(FLOOR) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): $(SOURCES)
	@scripts/setup.sh $(VENV) user
	@echo $(CURDIR) > $@

$(FLOOR_READY): $(SOURCES)
	@scripts/setup.sh $(FLOOR) floor
	@echo $(CURDIR) > $@

$(LINT_READY): $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint $(VENV)/constraints.txt --editable ".[lint]"
	@touch $@

$(BENCH_READY): $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint $(VENV)/constraints.txt --editable ".[bench]" && touch $@ \
		|| echo "pyins could not be installed: the bench goes without it" >&2
