# make demo   set everything up and grasp the paper's five objects: six node processes over real DDS on loopback
# make test   set everything up, lint, and run all tests
# make check  lint and the fast unit tests in under a minute, while a change is made
# make test-jazzy  run the node tests on the wheels of ROS 2 Jazzy
# make docs   build the manual into build/docs; a warning is an error
# make bench  print CPU and latency of the running system
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
JAZZY := .venv-jazzy
# Python keeps the bytecode of what it imports; to compile all that is installed takes as long as to install it. Where
# it may not keep it, each of the hundred processes that the tests start compiles numpy, scipy and numba anew.
PIP_OPTIONS := --quiet --disable-pip-version-check --no-compile
unexport PYTHONDONTWRITEBYTECODE
# Fast DDS stays on this machine; nothing joins a multicast group.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

define refuse-other-pythons
$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null || \
	{ echo "error: Python 3.10 to 3.13 is needed, found $$($(PYTHON) --version 2>&1 | head -n 1); name one: make PYTHON=python3.12" >&2; exit 1; }
endef

.PHONY: demo test check test-jazzy lint compiled docs bench clean

demo: compiled
	$(BIN)/mbpam demo $(DEMO_ARGS)

# Node processes run one after another in one worker, which waits for half of its time: so three workers on two cores.
test: $(VENV)/run.stamp
	@$(MAKE) --no-print-directory --jobs 2 lint compiled
	$(BIN)/python -m pytest --numprocesses 3 --dist loadgroup test

# All day: studies, properties, running nodes and what is marked slow take five sixths of the time and wait for `test`.
check: lint
	$(BIN)/python -m pytest --numprocesses 2 --dist loadgroup -m "not slow" test/unit --ignore test/unit/study

# The node tests on ROS 2 Jazzy, whose wheels must not share an environment with those of Kilted.
test-jazzy: $(JAZZY)/test.stamp
	@$(JAZZY)/bin/mbpam compile
	$(JAZZY)/bin/python -m pytest --numprocesses 2 --dist loadgroup test/integration

compiled: $(VENV)/run.stamp
	@$(BIN)/mbpam compile

lint: $(VENV)/test.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@if $(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then echo $(BIN)/mypy; $(BIN)/mypy; \
	else echo "types are not checked: those of numpy for Python 3.10 are older"; fi

docs: $(VENV)/docs.stamp
	$(BIN)/python -m sphinx --quiet --fail-on-warning --jobs 2 docs build/docs
	@echo "the manual is build/docs/index.html"

bench: $(VENV)/test.stamp
	$(BIN)/mbpam bench $(BENCH_ARGS)

$(VENV)/run.stamp: requirements.txt setup.py
	@$(call refuse-other-pythons)
	@echo "setting up $(VENV) with pinned wheels (once, about a minute)"
	@test -d $(VENV) || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install $(PIP_OPTIONS) -r requirements.txt
	@$(BIN)/python -m pip install $(PIP_OPTIONS) --no-deps -e .
	@touch $@

$(VENV)/test.stamp: $(VENV)/run.stamp requirements-test.txt
	@$(BIN)/python -m pip install $(PIP_OPTIONS) -r requirements-test.txt
	@touch $@

$(JAZZY)/test.stamp: requirements-jazzy.txt setup.py
	@$(call refuse-other-pythons)
	@echo "setting up $(JAZZY) with pinned wheels (once, about a minute)"
	@test -d $(JAZZY) || $(PYTHON) -m venv $(JAZZY)
	@$(JAZZY)/bin/python -m pip install $(PIP_OPTIONS) -r requirements-jazzy.txt
	@$(JAZZY)/bin/python -m pip install $(PIP_OPTIONS) --no-deps -e .
	@touch $@

$(VENV)/docs.stamp: $(VENV)/run.stamp requirements-docs.txt
	@$(BIN)/python -m pip install $(PIP_OPTIONS) -r requirements-docs.txt
	@touch $@

clean:
	rm -rf $(VENV) $(JAZZY) build install log report *.egg-info .pytest_cache .ruff_cache .mypy_cache
