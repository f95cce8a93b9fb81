# Everything a fresh machine needs is Python 3.11+, git and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
WHEEL_VENV := build/wheel-venv
PEERS := build/peers-venv/bin/python -m
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: demo test coverage check check-js docs bench peers wheel-check floors clean

demo: $(VENV)/installed  ## Run the main jobs: a docking, and the paper's scenario, from URDF to a result
	$(BIN)/spacerobot run docking --out out/docking
	$(BIN)/spacerobot animate out/docking --html out/docking/docking.html
	$(BIN)/spacerobot report out/docking
	$(BIN)/spacerobot run paper --out out/paper
	$(BIN)/spacerobot animate out/paper --html out/paper/paper.html
	$(BIN)/spacerobot report out/paper
	@echo
	@echo "Open out/docking/docking.html and out/paper/paper.html to see them move, report.html beside each to read about it."

test: $(VENV)/installed-all  ## Pass the tests
	$(BIN)/python -m pytest -n auto --dist worksteal

coverage: $(VENV)/installed-all  ## Run the tests and report which lines they reach, in build/coverage
	$(BIN)/python -m pip install --quiet --editable '.[coverage]'
	$(BIN)/python -m pytest -n auto --dist worksteal --cov --cov-report=term:skip-covered --cov-report=html

check: $(VENV)/installed-all  ## Lint and type-check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	@if command -v npm >/dev/null; then $(MAKE) --no-print-directory check-js; \
	else echo "The JavaScript of the pages was not checked: Node (nodejs and npm) is not installed."; fi

check-js: node_modules/installed  ## Lint and type-check the JavaScript of the pages, and compare vendored files with their packages
	node_modules/.bin/eslint viz/web
	node_modules/.bin/tsc --project jsconfig.json
	cmp node_modules/uplot/dist/uPlot.iife.min.js viz/web/vendor/uPlot.iife.min.js
	cmp node_modules/uplot/dist/uPlot.min.css viz/web/vendor/uPlot.min.css
	cmp node_modules/gifenc/dist/gifenc.esm.js viz/web/vendor/gifenc.esm.js
	cd node_modules/katex/dist && for file in katex.min.js katex.min.css fonts/*.woff2; do \
		cmp $$file $(CURDIR)/docs/javascripts/katex/$$file || exit 1; done

docs: $(VENV)/installed-all  ## The documentation's site, in build/site; a warning fails it
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	SPACEROBOT_SITE=build/site $(BIN)/python -m pytest -n 0 tests/docs/test_site.py
	@echo "Open build/site/index.html."

bench: $(VENV)/installed-all  ## Measure, each row as a ratio to something in the same run
	$(BIN)/python -m benchmarks

# Each peer is installed by itself, so that one that cannot be is one line of the table.
peers: export PIP_CONSTRAINT := $(CURDIR)/benchmarks/peers/constraints.txt
peers:  ## Simulate the same scenes with Basilisk, Drake, MuJoCo and Pinocchio; fill the table of docs/validation/peers.md
	$(PYTHON) -m venv build/peers-venv
	$(PEERS) pip install --quiet --editable .
	for peer in bsk drake mujoco; do $(PEERS) pip install --quiet $$peer || echo "$$peer cannot be installed"; done
	$(PEERS) benchmarks.peers

wheel-check: $(VENV)/installed-all  ## The built wheel, alone in a fresh environment, runs the paper's scenario
	rm -rf dist $(WHEEL_VENV)
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .
	$(PYTHON) -m venv $(WHEEL_VENV)
	$(WHEEL_VENV)/bin/python -m pip install --quiet dist/*.whl
	cd build && SPACEROBOT_COMPILER=none wheel-venv/bin/spacerobot run paper --out out

floors:  ## The lowest versions that pyproject.toml names simulate, tune and plan
	rm -rf build/floors && $(PYTHON) -m venv build/floors
	$(PYTHON) -c "import tomllib; d = tomllib.load(open('pyproject.toml', 'rb'))['project']['dependencies']; \
		open('build/floors.txt', 'w').write('\n'.join(x.replace('>=', '==') for x in d) + '\n')"
	PIP_CONSTRAINT= build/floors/bin/python -m pip install --quiet --only-binary :all: -r build/floors.txt
	PIP_CONSTRAINT= build/floors/bin/python -m pip install --quiet --no-deps --editable .
	build/floors/bin/spacerobot run paper --out build/floors-paper
	build/floors/bin/spacerobot figures build/floors-paper
	build/floors/bin/spacerobot tune paper --method cmaes --set simulation.duration=1 --set tuning.budget=40 --set tuning.runs=1 --out build/floors-tuned
	build/floors/bin/spacerobot plan capture --out build/floors-plan

$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/installed-all: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --editable '.[test,check]'
	touch $@

node_modules/installed: package.json
	npm install --no-package-lock --no-audit --no-fund --silent
	touch $@

clean:
	rm -rf $(VENV) node_modules build dist out .pytest_cache .mypy_cache .ruff_cache .hypothesis
