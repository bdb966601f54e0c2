# Commands to begin with: make demo, make live, make test. Each makes .venv and installs what it needs.
PYTHON ?= python3
VENV ?= .venv
RUN := $(VENV)/bin
# A module's tests stay together, as its fixtures are costly; 'make test TESTS=tests/kernels' runs some of them.
TESTS ?= -n 2 --dist loadscope

.PHONY: demo live arms test coverage fuzz mutation check docs bench clean
.DELETE_ON_ERROR:

demo: $(VENV)/.sims
	$(RUN)/dense-vs reach --robot painted --targets 5 --seed 0 --out out/demo

live: $(VENV)/.live
	$(RUN)/dense-vs live --robot painted --samples 1

arms: $(VENV)/.sims
	$(RUN)/dense-vs arms panda ur5e baxter fetch

test: $(VENV)/.dev
	$(RUN)/python -m pytest $(TESTS)

coverage: $(VENV)/.dev
	$(RUN)/python -m pytest $(TESTS) --cov --cov-branch

fuzz: $(VENV)/.dev
	DENSE_VS_FUZZ_TIMES=10 DENSE_VS_FUZZ_SEED=1000 $(RUN)/python -m pytest tests/fuzz $(TESTS)

mutation: $(VENV)/.dev
	nice -n 10 $(RUN)/python tools/mutation/run.py --json profiling/results/mutation.json

check: $(VENV)/.bench
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/pyright --pythonpath $(RUN)/python

docs: $(VENV)/.docs
	$(RUN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "open docs/_build/html/index.html"

bench: $(VENV)/.bench
	$(RUN)/python profiling/peers.py
	$(RUN)/python profiling/frame_budget.py

clean:
	rm -rf $(VENV) build dist out docs/_build *.egg-info

$(VENV)/bin/python:
	@sh tools/make_venv.sh $(PYTHON) $(VENV)

$(VENV)/.live: $(VENV)/.sims
	@echo "installing what the live page is served by"
	$(RUN)/python -m pip install --quiet -c constraints.txt -e ".[sims,viz,live]"
	@touch $@

# .dev contains what .sims and .live do, so any order of them installs nothing twice.
$(VENV)/.sims: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "installing the simulator and viewers (first run only, about a minute)"
	$(RUN)/python -m pip install --quiet -c constraints.txt -e ".[sims,viz]"
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "installing everything that tests need (first run only, about two minutes)"
	$(RUN)/python -m pip install --quiet -c constraints.txt -e ".[sims,viz,recordings,rerun,vos,live,dev]"
	@touch $@ $(VENV)/.sims $(VENV)/.live

$(VENV)/.docs: $(VENV)/.dev
	@echo "installing what the documentation is built with"
	$(RUN)/python -m pip install --quiet -c constraints.txt -e ".[docs]"
	@touch $@

$(VENV)/.bench: $(VENV)/.dev
	@echo "installing what profiling/ compares with (PyTorch among it)"
	$(RUN)/python -m pip install --quiet -c constraints.txt -e ".[bench]"
	@touch $@
