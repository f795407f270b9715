# make demo   what cyclopean does, from nothing          make lint, types, layers   the other checks
# make test   the tests                                  make bench                 the benchmarks
# make lock   renew the lock files (needs uv)            make clean                 back to a fresh clone

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
INSTALLED_DEV := $(VENV)/.installed-dev
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

.PHONY: demo test lint types layers bench lock clean
.DELETE_ON_ERROR:

demo: $(INSTALLED)
	$(BIN)/cyclopean demo

test: $(INSTALLED_DEV)
	$(BIN)/python -m pytest -q -n auto --maxprocesses 8 --dist worksteal

lint: $(INSTALLED_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED_DEV)
	$(BIN)/mypy

layers: $(INSTALLED_DEV)
	$(BIN)/python -m pytest -q tests/test_layers.py

bench: $(INSTALLED_DEV)
	set -e; for script in $$(grep -l '^if __name__ == "__main__"' benchmarks/*.py); do \
	    name=$$(basename $$script .py); echo "== $$name"; $(BIN)/python -m benchmarks.$$name; done

lock:
	uv pip compile --quiet --universal --generate-hashes --no-header --no-annotate --upgrade \
	    pyproject.toml --output-file requirements.lock
	uv pip compile --quiet --universal --generate-hashes --no-header --no-annotate --upgrade --extra dev \
	    pyproject.toml --output-file requirements-dev.lock

clean:
	rm -rf $(VENV) out build dist .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "cyclopean needs Python 3.11 or newer, but $(PYTHON) is $$($(PYTHON) --version 2>&1);" \
	         "try: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
	    echo "$(PYTHON) cannot make a virtual environment; on Debian: apt install python3-venv" >&2; exit 1; }

$(INSTALLED): pyproject.toml requirements.lock | $(BIN)/pip
	@echo "Installing cyclopean into $(VENV) (once)"
	@$(PIP) install --require-hashes -r requirements.lock
	@$(PIP) install --no-deps -e .
	@touch $@

$(INSTALLED_DEV): $(INSTALLED) requirements-dev.lock
	@echo "Installing the development tools into $(VENV) (once)"
	@$(PIP) install --require-hashes -r requirements-dev.lock
	@touch $@
