# `make demo`: one scan of the phantom, its finding and its report. `make demo-ur`: the same by a UR
# arm, whose controller is emulated. `make test`: every check.
# Each alone takes a fresh machine with Python 3.11 or newer to a finished result.

BIN := .venv/bin
export QT_QPA_PLATFORM ?= offscreen
# One thread per process: the solves are small, and tests run beside each other.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1

.PHONY: demo demo-ur test clean

demo: .venv/.installed
	$(BIN)/palpate scan --scene TIHA --seed 1 --out demo --report

demo-ur: .venv/.installed
	@mkdir -p demo; rm -f demo/ur.txt
	@$(BIN)/palpate emulate ur --scene TIHA </dev/null >demo/ur.txt & robot=$$!; \
	trap "kill $$robot" EXIT; \
	until grep -q faults demo/ur.txt; do kill -0 $$robot && sleep 0.2 || exit 1; done; \
	$(BIN)/palpate scan rigs/ur5e.toml --seed 1 --out demo --report

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
