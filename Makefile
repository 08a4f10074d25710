# make demo   plan, execute and verify: a pen is uncapped; the first call makes the environment
# make peers  other planners for `bipre bench motion --methods ours,roboplan,mplib`, each in its own environment
# make test   every check; `make test-slow` adds the long ones
PYTHON ?= $(shell for p in python3.11 python3 python; do \
	command -v $$p >/dev/null 2>&1 && $$p -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
DEMO := runs/demo
WORKERS ?= 2

.PHONY: demo test test-slow peers clean

demo: $(READY)
	$(BIN)/bipre plan Pen-Cap --seed 1 --video --out $(DEMO)
	$(BIN)/bipre verify $(DEMO)
	@echo
	@echo "video      $(DEMO)/execution.mp4   (still frames: $(DEMO)/execution.png)"
	@echo "plan       $(DEMO)/plan.html       open it in any browser"
	@echo "what was tried and why: $(BIN)/bipre why $(DEMO)"

test: $(READY)
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -n $(WORKERS) -m "not slow and not gpu"

test-slow: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) -m "not gpu"

$(READY): pyproject.toml requirements.lock
	@test -n "$(PYTHON)" || { echo "Python 3.11 was not found; install it or call: make PYTHON=/path/to/python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade -c requirements.lock setuptools
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation -c requirements.lock -e ".[video,dev,data,learn]"
	@touch $@

peers: .peers/roboplan/.ready .peers/mplib/.ready

.peers/roboplan/.ready:
	$(PYTHON) -m venv .peers/roboplan
	.peers/roboplan/bin/python -m pip install --quiet --disable-pip-version-check roboplan==0.7.0
	@touch $@

.peers/mplib/.ready:
	@test -n "$(PYTHON)" || { echo "Python 3.11 was not found; install it or call: make PYTHON=/path/to/python3.11"; exit 2; }
	$(PYTHON) -m venv .peers/mplib
	.peers/mplib/bin/python -m pip install --quiet --disable-pip-version-check mplib==0.2.1 "numpy<2"
	@touch $@

clean:
	rm -rf $(VENV) .peers .mypy_cache .ruff_cache .pytest_cache .import_linter_cache *.egg-info runs
