# `make demo`: one scan of the phantom, its finding and its report. `make test`: every check.
# Each alone takes a fresh machine with Python 3.11 or newer to a finished result.

BIN := .venv/bin
export QT_QPA_PLATFORM ?= offscreen
# One thread per process: the solves are small, and tests run beside each other.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1

.PHONY: demo test clean

demo: .venv/.installed
	$(BIN)/palpate scan --scene TIHA --seed 1 --out demo --report

test: .venv/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n 2

.venv/.installed: pyproject.toml .ci/install
	.ci/install ""
	touch $@

.venv/.installed-dev: pyproject.toml .ci/install
	.ci/install dev,cluster,mesh,netft,peers
	touch $@ .venv/.installed

clean:
	rm -rf .venv demo runs build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache
