# Each target does all its set-up on a fresh machine.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test test-fallback test-oldest test-newest coverage fuzz bench lint docs pictures man lock clean

demo: .venv/installed
	$(BIN)/tgospa-eval sample_data/quickstart/truth.csv sample_data/quickstart/estimate.csv --cutoff 10 --switch-penalty 5 --unit m \
		--pictures none --output demo
	@$(BIN)/python -c 'from pathlib import Path; print("\nTo see this result step by step, open in a browser:", Path("demo/report.html").absolute().as_uri(), sep="\n  ")'

test: .venv/installed-test
	$(BIN)/python -m pytest -n auto --dist worksteal

# What runs where there is no C compiler.
test-fallback: .venv/installed-test
	TGOSPA_EVAL_KERNEL=numpy $(BIN)/python -m pytest -n auto tests/contract/test_solver_contract.py \
		tests/contract/test_metric_properties.py tests/golden/test_known_values.py

# Golden values, the contract of the solvers, and every verb and output once, with the lowest versions that
# pyproject.toml allows, and with the newest of everything. Each has an environment of its own, with the wheel.
BOUNDS := tests/golden tests/contract/test_solver_contract.py tests/cli/test_smoke.py
test-oldest: .venv-oldest/bin/uv
	$(PYTHON) -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")' | \
		sed 's/>=/==/' > .venv-oldest/build.txt
	.venv-oldest/bin/uv pip install --quiet --python .venv-oldest --resolution lowest-direct \
		--build-constraints .venv-oldest/build.txt --reinstall-package tgospa-eval '.[smoke]'
	.venv-oldest/bin/pytest -n auto -W ignore $(BOUNDS)

test-newest: .venv-newest/bin/uv
	.venv-newest/bin/uv pip install --quiet --python .venv-newest --upgrade \
		--reinstall-package tgospa-eval '.[smoke]'
	.venv-newest/bin/pytest -n auto $(BOUNDS)

.venv-%/bin/uv:
	$(PYTHON) -m venv .venv-$*
	.venv-$*/bin/python -m pip install --quiet --disable-pip-version-check uv

# Lines and branches that the tests reach, the processes that they start included.
coverage: .venv/installed-dev
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -n auto --dist worksteal
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

# Properties with new seeds, for about this long.
SECONDS := 600
fuzz: .venv/installed-test
	$(BIN)/python tests/fuzz --seconds $(SECONDS)

bench: .venv/installed
	$(BIN)/python tests/benchmarks$(if $(BASE),/against.py $(BASE))

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -n auto -m types tests/contract/test_types.py
	$(BIN)/lint-imports

docs: .venv/installed-dev
	rm -rf docs/reference/api
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

# The pictures of the gallery, from the sample data.
pictures: .venv/installed-test
	$(BIN)/python docs/how-to/pictures/make.py

# The page of man, from the page of the command line.
man: .venv/installed-dev
	rm -rf docs/reference/api
	$(BIN)/python -m sphinx -W --keep-going -q -b man docs docs/_build/man

# The versions that development uses: the newest that pyproject.toml allows.
lock: .venv/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --extra dev \
		--no-emit-package setuptools --output-file requirements-dev.txt pyproject.toml

clean:
	rm -rf .venv .venv-oldest .venv-newest build demo dist docs/_build docs/reference/api *.egg-info .coverage* tgospa_eval/kernels/_kernels.c tgospa_eval/formats/text/_scan.c tgospa_eval/kernels/*.so \
		tgospa_eval/formats/text/*.so

.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("tgospa-eval needs Python 3.11 or newer; $(PYTHON) is %d.%d. With another: make PYTHON=python3.11 ..." % sys.version_info[:2])'
	@echo 'Making an environment for Python in .venv ...'
	$(PYTHON) -m venv .venv

# The one step that builds the package and its extension; the others only add to it.
.venv/installed: .venv/bin/python pyproject.toml tgospa_eval/kernels/_kernels.pyx $(wildcard tgospa_eval/kernels/*.pxi) tgospa_eval/formats/text/_scan.pyx
	@echo 'Installing tgospa-eval and its libraries into .venv, and compiling its inner loops, a few minutes ...'
	$(BIN)/python -m pip install --disable-pip-version-check --editable .
	touch $@

.venv/installed-test: .venv/installed requirements-dev.txt
	@echo 'Adding what the tests need, a few minutes ...'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint requirements-dev.txt 'tgospa-eval[test]'
	touch $@

.venv/installed-dev: .venv/installed-test
	@echo 'Adding what checks and documentation need, a few minutes ...'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint requirements-dev.txt 'tgospa-eval[dev]'
	touch $@
