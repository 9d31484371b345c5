# `make` lists what there is. Every target first sets up what it needs in .venv: you need Python >= 3.11 and make, nothing else.

PYTHON ?= python3
DATA ?= ../shared/data/ngsim*.gz
OUT ?= out/demo
FUZZ_INPUTS ?= 20000
FUZZ_SECONDS ?= 600
FUZZ_SEED ?= random
KILLS ?= 1000

BIN := .venv/bin
RUN := .venv/.stamp-run
SETUP := .venv/.stamp-setup
BENCH := .venv-bench/.stamp-setup
DOCS := .venv-docs/.stamp-setup
BROWSER := .venv/.stamp-browser
WEB := src/cornerforge/ext/explorer/static/index.html
WHEEL := .venv-wheel
# The wheel holds machine code for two kinds of x86-64, so that a first start compiles nothing; without: make wheel MACHINE_CODE=
# For one of them alone, as CI does: make wheel MACHINE_CODE=x86-64-v3
MACHINE_CODE ?= x86-64-v3 generic
export CORNERFORGE_MACHINE_CODE := $(if $(MACHINE_CODE),$(CURDIR)/build/machine-code)
PIP := -m pip -qq --disable-pip-version-check
SCRIPTS := $(wildcard benchmarks/*.py docs/_site/*.py examples/*.py supply/*.py)
LINTED := src tests $(SCRIPTS) docs/notebooks
# CI names a processor; a user does not.
AS_A_USER := env -u PYTHONPATH -u NUMBA_CPU_NAME -u NUMBA_CPU_FEATURES
# Tests of the installed wheel: storage, queries, processes of AVs, pictures, metrics, and the bits of a drive. They compile little.
WHEEL_TESTS := tests/adversary/test_policy_file.py tests/foreign/test_av_process.py tests/library tests/metrics \
	tests/report/test_report_figures.py tests/sim/test_digests.py tests/test_public_api.py
# Tests with the lowest versions: all that calls a library besides Numba and NumPy. Old releases warn of newer ones beneath them.
LOWEST := .venv-lowest/.stamp-setup
LOWEST_TESTS := tests/adversary tests/analysis tests/envs tests/foreign/test_av_process.py tests/foreign/test_network_files.py \
	tests/library tests/metrics tests/ndd tests/report tests/sim/test_digests.py tests/test_public_api.py
# Others' checkers and readers of what `cornerforge export` writes: their requirements fight ours and each other's.
EXTERNAL := tests/interchange/external
ASAM := .venv-asam/.stamp-setup
COMMONROAD := .venv-commonroad/.stamp-setup
AUDIT := .venv-audit/.stamp-setup
FULL := "not slow and not gpu and not browser and not interchange"
TEST_TOOLS := hypothesis mpmath onnx pytest
MODEL := src/cornerforge/ndd/default_model.npz
RL_AV := src/cornerforge/drivers/rl_av.safetensors
DANGER := src/cornerforge/rates/danger.npz

# Python's bytecode is kept: without it each of a thousand processes that tests start would compile 432 modules anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup environments web demo gallery test test-full kernels ledger test-slow fuzz kill test-browser test-interchange check format audit licences docs notebooks wheel lowest bench model rl-av danger validation golden clean-cache clean

help: ## list the targets (this)
	@awk -F ':.*## ' '/^[a-z][a-z-]*:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

setup: $(SETUP) ## install cornerforge and its tools into .venv, in the versions of constraints.txt

# For CI, as `make -j 2 environments`: each waits for the package index or for one core, so two at once take half the time.
environments: $(SETUP) $(DOCS) $(AUDIT) $(ASAM) $(COMMONROAD) $(BROWSER) $(WEB) ## set up all that checks and tests run in

web: $(WEB) ## build the explorer's page into the package (needs Node.js 20 or newer, which nothing else here does)

demo: $(RUN) ## find, sort and report corner cases of a built-in AV, and of one with a flaw, within minutes; goes on where it was stopped
	@$(BIN)/python supply/kernels.py --run
	@$(BIN)/cornerforge run --effort quick --out $(OUT) --resume
	@echo "The first report: $(OUT)/report.html (the AV with a flaw follows)"
	@$(BIN)/cornerforge rate --av flawed-not-behind --out $(OUT)-flawed --resume
	@$(BIN)/cornerforge report $(OUT)-flawed --out $(OUT)-flawed/page
	@echo "The reports (open them in a browser): $(OUT)/report.html, and of an AV with a flaw $(OUT)-flawed/page/report.html"

gallery: $(BROWSER) $(WEB) demo ## make the pictures of README and docs, and a gallery of sixteen filmed cases: docs/gallery.md
	@$(BIN)/python supply/gallery.py --demo $(OUT)

test: kernels ## run the default tests and the examples in docstrings, within minutes: offline, on the CPU, on all cores
	@$(BIN)/python -m pytest -q -n auto --dist loadfile --durations 10

test-full: kernels ## run all tests but those at full scale: before a merge, and before an issue is closed (some 20 minutes)
	@$(BIN)/python -m pytest -q -m $(FULL) --hypothesis-profile full -n auto --dist loadfile --durations 25

kernels: $(SETUP) ## compile what commands need, on all cores, unless it is there already
	@$(BIN)/python supply/kernels.py

ledger: $(SETUP) ## run all tests but those at full scale, and write down what each costs, and what it compiles: docs/test-ledger.md
	@rm -rf .pytest_cache/ledger && mkdir -p .pytest_cache/ledger
	@$(BIN)/python -m pytest -q -m $(FULL) --hypothesis-profile full -n auto --dist loadfile --ledger=.pytest_cache/ledger; \
	  $(BIN)/python tests/costs.py .pytest_cache/ledger docs/test-ledger.md "Last made on $$(date +%F), of commit $$(git rev-parse --short HEAD)."

test-slow: $(SETUP) ## run the tests at full scale too, on a seed drawn now and printed
	@$(BIN)/python -m pytest -m "not gpu and not browser and not interchange" --seed random --hypothesis-profile slow

fuzz: $(SETUP) ## put damaged and hostile inputs of every kind through all readers: FUZZ_INPUTS, FUZZ_SECONDS, FUZZ_SEED say how many
	@cd tests && PYTHONPATH=. $(abspath $(BIN))/python -m fuzz.run --inputs $(FUZZ_INPUTS) --seconds $(FUZZ_SECONDS) --seed $(FUZZ_SEED)

kill: $(SETUP) ## kill all long commands at random moments, resume them, and compare: KILLS=1000 by default, SEED=N repeats
	@$(BIN)/python tests/kill/killing.py --kills $(KILLS) $(if $(SEED),--seed $(SEED))

test-browser: $(SETUP) $(WEB) $(BROWSER) ## test the explorer and the pages: their scripts with Vitest, and all of it in Chromium
	@cd web && npm test --silent
	@$(BIN)/python -m pytest -m browser -n auto --dist loadfile --durations 5 tests/browser tests/report tests/verbs/test_retest_page.py

test-interchange: $(SETUP) $(ASAM) $(COMMONROAD) ## let checkers and readers made by others judge the files of cases that we write
	@ASAM_PYTHON=$(CURDIR)/.venv-asam/bin/python COMMONROAD_PYTHON=$(CURDIR)/.venv-commonroad/bin/python \
	  $(BIN)/python -m pytest -m interchange -n auto --dist loadfile --durations 5 $(EXTERNAL)

check: $(SETUP) ## check format, lint, types, layers and spelling; changes nothing
	@$(BIN)/ruff format --check --quiet --output-format concise $(LINTED) || { echo "Not formatted; format it with: make format"; exit 1; }
	@$(BIN)/ruff check --quiet $(LINTED)
	@$(BIN)/mypy --cache-dir .mypy_cache/tests tests $(SCRIPTS) & tests=$$!; $(BIN)/mypy --strict src && wait $$tests
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/codespell

format: $(SETUP) ## write the agreed format and mend what lint can mend by itself
	@$(BIN)/ruff check --quiet --fix-only $(LINTED)
	@$(BIN)/ruff format $(LINTED)

audit: $(AUDIT) ## look for known faults in what cornerforge is made of; asks services that know, where one is reached
	@.venv-audit/bin/python supply/audit.py

licences: $(SETUP) $(AUDIT) $(WEB) ## list the licences of all dependencies again: docs/licences.md
	@.venv-audit/bin/python $(PIP) install --dry-run --ignore-installed --no-deps --report .venv-audit/report.json -r constraints.txt
	@$(BIN)/python supply/licences.py .venv-audit/report.json

docs: $(DOCS) ## build the documentation as a site that loads nothing from elsewhere: site/index.html
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --strict --quiet
	@.venv-docs/bin/python docs/_site/site_check.py site

notebooks: kernels ## run the notebooks of docs/notebooks anew, in their order, and write them with their outputs
	@$(BIN)/python supply/notebooks.py

# All archives are built by the setuptools of constraints.txt: another one may write other bytes.
# The tests run from the unpacked source archive, without its src/: what they import can only be the installed wheel.
wheel: $(SETUP) $(AUDIT) $(WEB) ## build the source archive and the wheel, and try them in an environment of their own: dist/
	@rm -rf build dist $(WHEEL)
	@$(if $(MACHINE_CODE),$(BIN)/python supply/kernels.py build/machine-code $(MACHINE_CODE))
	@PIP_CONSTRAINT=constraints.txt $(BIN)/python -m build --outdir dist . >build.log 2>&1 || { cat build.log; exit 1; }
	@PIP_CONSTRAINT=constraints.txt $(BIN)/python -m build --wheel --outdir build/direct . >build.log 2>&1 || { cat build.log; exit 1; }
	@rm build.log
	@$(BIN)/python tests/installed/archives.py dist build/direct
	@$(BIN)/python tests/installed/twice.py dist build/direct
	@.venv-audit/bin/python tests/installed/bill.py dist
	@$(call venv,$(WHEEL))
	@$(WHEEL)/bin/python $(PIP) install --no-compile -c constraints.txt dist/*.whl
	@$(AS_A_USER) $(WHEEL)/bin/python -I tests/installed/as_a_user.py
	@$(WHEEL)/bin/python $(PIP) install --no-compile -c constraints.txt "$$(ls dist/*.whl)[all]" hypothesis onnx pytest pytest-xdist
	@mkdir $(WHEEL)/source && tar -xzf dist/*.tar.gz --strip-components 1 -C $(WHEEL)/source && rm -r $(WHEEL)/source/src
	@cd $(WHEEL)/source && $(AS_A_USER) ../bin/python -m pytest -q -n auto --dist loadfile $(WHEEL_TESTS)

lowest: $(LOWEST) ## run tests with the lowest versions that pyproject.toml allows (some gigabytes: old torch with its GPU libraries)
	@env -u PYTHONPATH .venv-lowest/bin/python -m pytest -q -p no:cacheprovider -W default::DeprecationWarning \
	  -W default::PendingDeprecationWarning -W default::FutureWarning $(LOWEST_TESTS)

bench: $(BENCH) ## measure speeds (benchmarks/run.py), in an environment of its own with the tools we compare with
	@.venv-bench/bin/python benchmarks/run.py

model: $(SETUP) ## fit the default naturalistic model again from DATA="FILES" (see docs/design.md); same data, same bytes
	@test -n "$(wildcard $(DATA))" || { echo "No data at $(DATA); say where it is: make model DATA='my/data/*.gz'"; exit 1; }
	@$(BIN)/cornerforge ndd fit $(sort $(wildcard $(DATA))) --format ngsim --lane-changes prior --out $(MODEL)

rl-av: $(RUN) ## train the built-in AV `rl` again; same seed, same weights
	@$(BIN)/cornerforge train-av --out $(RL_AV) --overwrite --tests 200000

danger: $(RUN) ## teach again, at length, the network of dangers that rates by trees begin with
	@$(BIN)/python supply/danger.py $(DANGER)

validation: $(RUN) ## validate the shipped traffic model again (recordings in ../shared/data), for report --evidence
	@$(BIN)/python supply/validation.py src/cornerforge/ext/evidence/validation.json

golden: $(SETUP) ## write the checked-in expectations (golden files) again; read the diff and say why in the commit
	@$(BIN)/python -m pytest -q -m golden --write-golden
	@git --no-pager diff --stat -- tests

clean-cache: $(RUN) ## drop the compiled kernels; the next start compiles them anew (needed only if in doubt)
	@$(BIN)/python -c "import pathlib, cornerforge._kernel_cache as c; [f.unlink() for f in pathlib.Path(c.cache_folder()).glob('*.nbc')]"

clean: ## drop all that make made, .venv too; keeps out/
	@rm -rf .venv .venv-* build dist site web/node_modules src/cornerforge/ext/explorer/static .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	@find src tests -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is newer than the two files that decide what gets installed, or the installation runs again.
# What `run`, `rate` and `report` need, and no more: of the extra `report` no matplotlib. Python compiles what it imports at
# the first start; pip would compile all of torch. What only tests the packages themselves goes, and of torch what only
# builds C++: 250 MB. A torch without GPU libraries, where pip would take another:
# PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu make demo
$(RUN): pyproject.toml constraints.txt
	@$(call venv,.venv)
	@$(BIN)/python $(PIP) install --no-compile -c constraints.txt -e ".[learn,analysis]" jinja2 plotly
	@cd .venv/lib/python3*/site-packages && rm -rf torch/test torch/include torch/bin/*[Tt]est* torch/bin/protoc* && \
	  find . -type d -name tests -prune -exec rm -rf {} +
	@touch $@

$(SETUP): pyproject.toml constraints.txt
	@$(call venv,.venv)
	@$(BIN)/python $(PIP) install --no-compile -c constraints.txt -e ".[all,dev]"
	@touch $(RUN) $@

web/node_modules/.stamp-setup: web/package.json web/package-lock.json
	@command -v npm >/dev/null || { echo "The explorer's page is built with Node.js 20 or newer: install it, then make web."; exit 1; }
	@cd web && npm ci --no-audit --no-fund --loglevel error && touch node_modules/.stamp-setup

$(WEB): web/node_modules/.stamp-setup web/build.mjs web/pages.mjs web/tsconfig.json $(shell find web/src -type f)
	@cd web && npm run --silent check && npm run --silent build

# Chromium is the system's: on Debian and Ubuntu it is installed here, if that is allowed.
$(BROWSER): $(SETUP)
	@command -v chromium >/dev/null || { command -v apt-get >/dev/null && test "$$(id -u)" = 0 && \
	  { apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y chromium; } >apt.log 2>&1 && rm apt.log; } || \
	  { echo "The tests need Chromium as the program chromium; install it, for example: sudo apt-get install chromium"; exit 1; }
	@$(BIN)/python $(PIP) install -c constraints.txt -e ".[browser]"
	@touch $@

$(BENCH): pyproject.toml constraints.txt
	@$(call venv,.venv-bench)
	@.venv-bench/bin/python $(PIP) install -c constraints.txt -e ".[all,bench]"
	@touch $@

# The site is made from texts: the package itself is not installed, only the tools that the extra `docs` names.
$(DOCS): pyproject.toml constraints.txt
	@$(call venv,.venv-docs)
	@.venv-docs/bin/python $(PIP) install -c constraints.txt $$($(PYTHON) -c 'import tomllib; \
	  print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"])')
	@touch $@

$(AUDIT): supply/requirements.txt
	@$(call venv,.venv-audit)
	@.venv-audit/bin/python $(PIP) install -r $<
	@touch $@

$(ASAM): $(EXTERNAL)/requirements-asam.txt
	@$(call venv,.venv-asam)
	@.venv-asam/bin/python $(PIP) install -r $<
	@touch $@

$(COMMONROAD): $(EXTERNAL)/requirements-commonroad.txt
	@$(call venv,.venv-commonroad)
	@.venv-commonroad/bin/python $(PIP) install -r $<
	@touch $@

# Direct requirements in their lowest versions, what these require in its newest; the package is not editable, since the
# kernels' machine code beside src/ belongs to the Numba of .venv.
$(LOWEST): pyproject.toml
	@rm -rf .venv-lowest
	@$(call venv,.venv-lowest)
	@.venv-lowest/bin/python $(PIP) install uv
	@$(PYTHON) -c 'import sys, tomllib; dev = tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["dev"]; \
	  print(*(line for line in dev if line.split(">=")[0] in sys.argv[1:]), sep="\n")' $(TEST_TOOLS) >.venv-lowest/tools.in
	@.venv-lowest/bin/uv pip compile -q --resolution lowest-direct --python .venv-lowest/bin/python --extra all --extra sb3 \
	  pyproject.toml .venv-lowest/tools.in -o .venv-lowest/lowest.txt
	@.venv-lowest/bin/uv pip install -q --python .venv-lowest/bin/python -r .venv-lowest/lowest.txt
	@.venv-lowest/bin/uv pip install -q --python .venv-lowest/bin/python --no-deps .
	@touch $@

define venv
$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
  { echo "cornerforge needs Python 3.11 or newer, and $(PYTHON) is not; say which to use: make setup PYTHON=python3.12"; exit 1; }; \
test -x $(1)/bin/python || { echo "Setting up $(1) (once)" && $(PYTHON) -m venv $(1); }
endef
