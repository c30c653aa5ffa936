SHELL := /bin/bash
.DEFAULT_GOAL := help

# Every command runs in the environment that the set-up leaves behind; nothing is
# read from or written to the home folder.
in_environment := . .venv/env.sh &&

.PHONY: help setup demo test lint format bench soak clean

help:  ## show this list
	@sed -n "s/^\([a-z]*\): .*## \(.*\)/  make \1\t\2/p" Makefile | expand -t 14
	@echo; echo "  PYTHON=/path/to/python3.12 chooses the interpreter (3.11 or 3.12)."

setup:  ## Python environment with ROS 2 Jazzy, and the three packages built
	@.ci/setup
	@echo "ready: type  . .venv/env.sh  to use robot-energy and the nodes"

demo: prepare  ## a virtual robot with its energy monitor
	@$(in_environment) python -m ros2_energy_monitor.demo

test: prepare  ## format, lint, types, all tests
	@$(in_environment) python .ci/check.py

lint: prepare  ## format, lint and types only
	@$(in_environment) python .ci/check.py --lint

format: prepare  ## format the sources and mend what ruff can mend
	@$(in_environment) ruff format src test ros2_energy_monitor .ci && ruff check --fix src test ros2_energy_monitor .ci

bench: prepare  ## measure speed
	@$(in_environment) python test/bench/run.py

soak: prepare  ## runs that take long: a simulated month, load, fuzzing, bit rot
	@$(in_environment) pip install --quiet --disable-pip-version-check --no-input --no-deps -r .ci/requirements-soak.txt && python test/soak/run.py

clean:  ## remove all that set-up and tests made
	rm -rf .venv build install log

.PHONY: prepare
prepare:
	@.ci/setup
