SHELL := /bin/bash
.DEFAULT_GOAL := help

# Every command runs in the environment that the set-up leaves behind; nothing is
# read from or written to the home folder.
in_environment := . .venv/env.sh &&

.PHONY: help setup demo test coverage lint format docs wheel bench soak clean

help:  ## show this list
	@sed -n "s/^\([a-z]*\): .*## \(.*\)/  make \1\t\2/p" Makefile | expand -t 14
	@echo; echo "  PYTHON=/path/to/python3.12 chooses the interpreter (3.11 or 3.12)."
	@echo "  YES=1 lets the set-up, as root, install missing system packages without a question."

setup:  ## Python environment with ROS 2 Jazzy, and the three packages built
	@.ci/setup
	@echo "ready: type  . .venv/env.sh  to use robot-energy and the nodes"

demo: prepare  ## a virtual robot with its energy monitor
	@$(in_environment) python -m ros2_energy_monitor demo

test: prepare .venv/tests build/robots/pins  ## format, lint, types, all tests
	@$(in_environment) python .ci/check.py

coverage: prepare .venv/tests build/robots/pins  ## the share of the whole library that its tests run; as long as the tests twice
	@$(in_environment) python .ci/check.py --coverage

lint: prepare .venv/tests  ## format, lint and types only; the lines of each package, the way of each message
	@$(in_environment) python .ci/check.py --lint && python .ci/lines.py && python .ci/ways.py

format: prepare .venv/tests  ## format the sources and mend what ruff can mend
	@$(in_environment) ruff format src test ros2_energy_monitor .ci && ruff check --fix src test ros2_energy_monitor .ci

docs: prepare  ## the documentation site in build/site; warnings are errors, and outputs of its pages are those of the programs
	@$(in_environment) python .ci/pages.py src/doc/tutorial.md src/doc/gallery.md src/doc/api/*.md
	@$(in_environment) pip install --quiet --disable-pip-version-check --no-input --no-deps --require-hashes --upgrade --target build/sphinx -r .ci/requirements-docs.txt
	@$(in_environment) PYTHONPATH="build/sphinx:$$PYTHONPATH" python -m sphinx -q -W --keep-going -b html src/doc build/site
	@echo "made build/site/index.html"

DIST ?= build/dist
wheel:  ## wheel and source distribution of the library in build/dist
	@rm -rf src/build src/*.egg-info
	@$(in_environment) pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir "$(abspath $(DIST))" ./src
	@$(in_environment) cd src && python setup.py --quiet sdist --dist-dir "$(abspath $(DIST))" 2>/dev/null
	@rm -rf src/build src/*.egg-info && ls "$(abspath $(DIST))"

bench: prepare .venv/tests  ## measure speed
	@$(in_environment) python test/bench/run.py

soak: prepare .venv/tests build/urdfs/pins  ## what takes long: tests marked so, a simulated month, load, fuzzing, bit rot
	@$(in_environment) pip install --quiet --disable-pip-version-check --no-input --no-deps --require-hashes -r .ci/requirements-soak.txt && pytest -q -c test/pytest.ini test -m long && pytest -q -c ros2_energy_monitor/setup.cfg ros2_energy_monitor/test -m long && python test/soak/run.py

clean:  ## remove all that set-up and tests made
	rm -rf .venv build install log

# What only tests and checks need; the stamp goes with an environment that is made again.
.venv/tests: .ci/requirements-test.txt | prepare
	@echo "set-up: tools of tests and checks ..."
	@.venv/bin/python -I .ci/workspace.py $< && cp $< $@

# URDFs of robots, for one test and for one long run; made again when their pins change.
build/robots/pins build/urdfs/pins: build/%/pins: .ci/requirements-%.txt | prepare
	@$(in_environment) pip install --quiet --disable-pip-version-check --no-input --no-deps --require-hashes --upgrade --target build/$* -r $< && cp $< $@

.PHONY: prepare
prepare:
	@.ci/setup
