# make demo: run the tee turn and leave results, plot, video and replay page in
# out/tee_turn; sets up the package alone in .venv.
# make test: run the tests of what the program computes, in 7 to 13 minutes on two cores; adds what
# tests, checks and pages need. Both set up EGL first. Another Python, or a second environment:
# PYTHON=python3.13 VENV=.venv-3.13
# make test-long: run the tests marked `long`: browsers, windows, notebooks, wheels, the site, examples
# of the docs, killed processes, statistics, odd files by a seed of the day. Sets up Chromium and Xvfb first.
# make coverage: measure which lines and branches `make test` runs, and print a row for each room.
# make quick: run laws of every room in less than a minute.
# make docs: build the documentation into out/site, strictly.
# make figures: make the figures and tables of README and docs anew, hours; PARTS="NAME ..." of
# docs/figures.toml makes these alone.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PACKAGE := $(VENV)/.package
READY := $(VENV)/.ready
LONG := $(VENV)/.long
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
SCREEN_PACKAGES := chromium xvfb xdotool
EGL_PACKAGES := libegl1 libgl1-mesa-dri libopengl0

# Tests start some hundred processes; without bytecode each of them would compile the package.
unexport PYTHONDONTWRITEBYTECODE
# Three processes have two cores: threads of NumPy's linear algebra, which wait for each other by
# spinning, would cost recognition a twentieth of its time.
test test-long: export OPENBLAS_NUM_THREADS := 1

.PHONY: demo test test-long mutants coverage quick check docs figures models bench tutorial lowest egl screen clean

demo: $(PACKAGE) egl
	$(BIN)/omnitrack run scenarios/tee_turn.toml --out out/tee_turn
	@echo "To play it, open $(CURDIR)/out/tee_turn/replay.html in a browser"

# Three processes on two cores: some of their time tests wait for other processes.
PYTEST := $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder
test: $(READY) egl
	$(PYTEST) -m "not long"

test-long: $(LONG) egl screen
	$(PYTEST) -m "long or device"

# Faults by lot, tried with the tests of `make test`: SEED=2 COUNT=100 ROOM=senses
SEED ?= 1
COUNT ?= 40
mutants: $(READY)
	$(BIN)/python benchmarks/mutants.py --seed $(SEED) --count $(COUNT) $(if $(ROOM),--room $(ROOM))

# What each test process leaves is put together; then a line for each room with its totals.
coverage: $(READY) egl
	$(BIN)/python -m coverage erase
	$(BIN)/python -m coverage run -m pytest -n 0 -m "not long"
	$(BIN)/python -m coverage combine --quiet
	@for room in omnitrack_sim/*/; do \
	  echo "$$room $$($(BIN)/python -m coverage report --include="$$room*" | tail -n 1)"; done

# Laws of every room, in less than a minute: for use while editing.
QUICK := rotations writing pipes network metric_laws events walls kinematics motors control_laws \
  singularity readings pose_filter planning maps scenario result monitor sweep_spec study_search \
  gym_refusals verdicts trials_bar
quick: $(READY)
	$(BIN)/python -m pytest -n 2 --dist loadfile $(QUICK:%=tests/test_%.py)

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/omnitrack models --check
	$(BIN)/python docs/site/tables.py --check

docs: $(READY)
	$(BIN)/python docs/site/build.py

models: $(READY)
	$(BIN)/omnitrack models --write

bench: $(READY)
	$(BIN)/python benchmarks/speed.py

figures: $(READY) egl screen
	$(BIN)/python benchmarks/make_figures.py $(PARTS)

tutorial: $(READY)
	$(BIN)/python docs/tutorials/tutorial.py

# A bare Debian has python3 without ensurepip: python3-venv brings it.
$(PACKAGE): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  if [ "$$(id -u)" = 0 ]; then apt-get update -qq && apt-get install -y -qq python3-venv; \
	  else echo "Python's venv is missing. Run: sudo apt-get install -y python3-venv"; exit 1; fi; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(PIP) --upgrade 'pip>=25.1'
	@$(PIP) --no-compile --editable .
	@touch $@

# Of 173 MB of libraries the tests import 32: libraries are compiled to bytecode as they are
# imported.
$(READY): $(PACKAGE)
	@$(PIP) --no-compile --group dev
	@touch $@

$(LONG): $(READY)
	@$(PIP) --no-compile --group long
	@touch $@

# The lowest releases that pyproject.toml allows, but for the tools of `make check`.
lowest: $(READY)
	$(PIP) uv
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/uv pip install --upgrade --resolution lowest-direct --only-binary :all: \
	  --no-binary omnitrack_sim --editable . --group test

# Offscreen rendering needs Mesa's EGL. Without it everything but pictures works.
egl:
	@if $(PYTHON) -c 'import ctypes; [ctypes.CDLL(n) for n in ("libEGL.so.1", "libOpenGL.so.0")]' 2>/dev/null; then :; \
	elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  { apt-get update -qq && apt-get install -y -qq $(EGL_PACKAGES); } >/dev/null 2>&1 \
	  || echo "The EGL libraries could not be installed; there will be no video. Needed: $(EGL_PACKAGES)"; \
	else echo "No EGL: there will be no video. For one, run: sudo apt-get install -y $(EGL_PACKAGES)"; fi

# The tests of pages and windows need a browser, a screen and keys sent to it. Without them these
# tests are left out.
screen:
	@if command -v chromium >/dev/null && command -v Xvfb >/dev/null && command -v xdotool >/dev/null; then :; \
	elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  { apt-get update -qq && apt-get install -y -qq $(SCREEN_PACKAGES); } >/dev/null 2>&1 \
	  || echo "Browser and screen could not be installed; their tests are left out. Needed: $(SCREEN_PACKAGES)"; \
	else echo "The tests of pages and windows are left out. For them, run: sudo apt-get install -y $(SCREEN_PACKAGES)"; fi

clean:
	rm -rf $(VENV) out dist build .pytest_cache .ruff_cache
