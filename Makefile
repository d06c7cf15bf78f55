# `make demo`: one scan of the phantom, its finding and its report. `make demo-ur`: the same by a UR
# arm, whose controller is emulated. `make test`: every check. `make figures`: what the documentation's numbers
# are measured by. `make install`: palpate with all its extras. Each runs by itself on a fresh machine
# with Python 3.11 or newer.

BIN := .venv/bin
export QT_QPA_PLATFORM ?= offscreen
# One thread per process: the solves are small, and tests run beside each other.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1

# Tests start hundreds of processes: each would compile anew all that it imports.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install demo demo-ur test types beside first-computing-then-waiting test-peers test-lowest figures clean

install: .venv/.installed-all
	@echo "To use it here: . $(BIN)/activate && palpate --help"

demo: .venv/.installed-report
	$(BIN)/palpate scan --scene TIHA --seed 1 --out demo --report
	@echo "Next: make install && . $(BIN)/activate && palpate --help"

demo-ur: .venv/.installed-report,ur
	@mkdir -p demo; rm -f demo/ur.txt
	@$(BIN)/palpate emulate ur --scene TIHA </dev/null >demo/ur.txt & robot=$$!; \
	trap "kill $$robot" EXIT; \
	until grep -q faults demo/ur.txt; do kill -0 $$robot && sleep 0.2 || exit 1; done; \
	$(BIN)/palpate scan rigs/ur5e.toml --seed 1 --out demo --report

# Tests of emulated devices, of a cluster and of stopped processes, on the wall clock, come after the
# others, so that no computing keeps their guards waiting. Four of them share the machine with the types and the finite
# elements, which have all along what the others leave of the processors; what fails is asked again
# once all else is done.
WAITING := tests/drivers tests/probe/guards tests/probe/scan tests/probe/checks \
	tests/probe/calibrate/test_weigh.py tests/probe/cli/test_emulate.py tests/probe/cli/test_processes.py \
	tests/probe/config/test_fallback.py tests/probe/gui/test_app.py tests/probe/storage/test_lost_files.py \
	tests/probe/studies/test_cluster.py tests/probe/studies/test_stopped_sweeps.py \
	tests/sim_backend/emulators tests/test_add_a_driver.py
BESIDE := tests/sim_backend/fem

test: .venv/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(MAKE) --no-print-directory --jobs 2 beside first-computing-then-waiting
	for round in 1 2 3; do \
		$(BIN)/pytest --last-failed --last-failed-no-failures none $(WAITING); status=$$?; \
		[ $$status = 1 ] || break; \
	done; [ $$status = 0 ] || [ $$status = 5 ]  # 5: no test, as none had failed

types:
	$(BIN)/mypy

beside:
	nice -n 19 $(BIN)/lint-imports
	nice -n 19 $(MAKE) --no-print-directory types
	nice -n 19 $(BIN)/pytest -p no:cacheprovider --timeout 900 $(BESIDE)

first-computing-then-waiting:
	$(BIN)/pytest -n 2 --dist worksteal $(patsubst %,--ignore=%,$(WAITING) $(BESIDE))
	$(BIN)/pytest -n 4 --dist worksteal $(WAITING) || [ $$? = 1 ]  # tests failed, and nothing else

# At the lowest versions that pyproject.toml allows, in an environment of its own.
test-lowest:
	.ci/lowest $(patsubst %,--ignore=%,$(WAITING))

# Against software that we did not write: makers' client libraries drive the emulated controllers. Our
# drivers move grblHAL's simulator if PALPATE_GRBLHAL is its path, and URSim if Docker is there or
# PALPATE_URSIM is its address; what is not there is skipped with the reason.
test-peers: .venv/.installed-dev
	$(BIN)/pip install --quiet zaber-motion pipython PyTrinamic panda-python
	$(BIN)/pytest -n 2 -rs tests/peers

# The documentation's numbers and pictures: all, or ONLY="paper fleet". 45 minutes.
figures: .venv/.installed-dev
	cd benchmarks && ../$(BIN)/python -m figures $(ONLY)

.venv/.installed-%: pyproject.toml .ci/install $(wildcard sim_backend/fem/kernel/*.[ch])
	.ci/install $*
	touch $@

clean:
	rm -rf .venv demo runs build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache
