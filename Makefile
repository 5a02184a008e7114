# One command per task. Each makes what it needs in .venv; nothing outside this folder is touched.
# Needed: make, python3 (>= 3.11) with its venv module, a C linker (cc) and cargo. What is missing is named, with how to get it.

SHELL := /bin/sh
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

# The first interpreter that is new enough; PYTHON=... chooses another.
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)
VENV := .venv
BIN := $(VENV)/bin
CRATE := retarget/solver
MANIFEST := $(CRATE)/Cargo.toml
RUST := $(MANIFEST) $(CRATE)/Cargo.lock $(shell find $(CRATE)/src -name '*.rs' -not -path '*/src/tests/*')
RUST_OLDEST := 1.83
RUST_TARGETS := x86_64-unknown-linux-gnu aarch64-unknown-linux-gnu
JOBS ?= 2
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Without bytecode every process of a test, and every worker, would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE

PLUGIN := plugins/lerobot_robot_retarget
LEROBOT := .venv-lerobot
# LeRobot 0.6 needs Python 3.12 or 3.13.
LEROBOT_PYTHON ?= $(shell for p in python3.12 python3.13 python3; do \
	$$p -c 'import sys; sys.exit(not (3, 12) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null && { echo $$p; break; }; done)

.PHONY: help web browser demo test lint golden golden-store same-bits bench bench-bus bench-tick bench-lateness bench-latency bench-viewer bench-physics paper gallery pictures robustness mutants fuzz long slow-part lerobot docs docs-tables wheels clean machine

help:
	@echo 'make demo    a performer waves and squats, an OP3 on emulated servos follows; report and pictures in out/demo'
	@echo 'make web     what web:// needs: your camera, phone or headset as the performer'
	@echo 'make test    every test but the slow ones (make long)'
	@echo 'make browser  the tests of web:// in headless Chromium, with the real body tracker; minutes'
	@echo 'make lerobot  the plug-in in the real LeRobot: teleoperate, record, replay; fetches 2.8 GB once'
	@echo 'make lint    ruff, mypy, cargo fmt, clippy'
	@echo 'make golden AGAINST=COMMIT  the same runs by that commit and by this checkout, compared to the bit; minutes; GOLDEN="--only poppy" plays a part'
	@echo 'make golden-store  renew the stored runs that make test compares with'
	@echo 'make same-bits  the same runs as if by other processors, compared to the bit; minutes; BITS="--short --aarch64" adds one under qemu'
	@echo 'make bench   our frame time beside PlaCo and mink'
	@echo 'make bench-bus  a cycle of the bus beside dynamixel-sdk'
	@echo 'make bench-tick  what a live tick computes, datagram in to goal bytes out'
	@echo 'make bench-lateness  how late ticks of the live loop wake up, beside an empty loop'
	@echo 'make bench-latency  how long a motion of a hand takes to the shafts, by stage'
	@echo 'make bench-viewer  what a page of a run costs its ticks'
	@echo 'make bench-physics  how many times faster than real time a robot with mass runs'
	@echo 'make paper   the experiments and figures of the paper, run anew'
	@echo 'make gallery  the animation of one motion on every shipped robot'
	@echo 'make pictures  the pictures of the documentation, pages in headless Chromium; minutes'
	@echo 'make robustness  in how many runs under perturbations it stands; takes hours'
	@echo 'make mutants  every protection of guard, gate, supervisor, loop, readers and writers removed in turn: does a test fail?'
	@echo 'make fuzz N=100000  so many damaged files of every kind: each is read, or refused by a message'
	@echo 'make long    the slow tests, a second to minutes each; ten hours of one core'
	@echo 'make slow-part  those of them that are due today, a ninetieth, in some 8 minutes; DAY=N: of another day of the year'
	@echo 'make docs-tables  the measured tables of the pages, from docs/tables and from what is computed in a second'
	@echo 'make docs    the documentation site in out/site; it opens from disk'
	@echo 'make wheels  wheels for x86-64 and aarch64 and an sdist in wheels/, tried in an empty environment; minutes'
	@echo 'make clean   remove .venv and everything built'

web: $(VENV)/.with-web
	$(BIN)/retarget web install

demo: $(VENV)/.with-base
	@echo 'Playing the demo and writing its report: some 20 seconds.'
	$(BIN)/retarget demo

test: $(VENV)/.with-test
	CARGO_PROFILE_RELEASE_LTO=off cargo test --release --lib --locked --quiet --features count-allocations --manifest-path $(MANIFEST)
	$(BIN)/python -m pytest -n $(JOBS) -m 'not long' --durations 20 $(PYTEST)

long: $(VENV)/.with-test
	$(BIN)/python -m pytest -m long --timeout 0 $(PYTEST)

ifndef DAY
DAY := $(shell date +%j | sed 's/^0*//')
endif

# Some of them need real time, so they run one after the other.
slow-part: $(VENV)/.with-test
	@echo 'The slow tests that are due on day $(DAY) of the year; none begins after 8 minutes. Again: make slow-part DAY=$(DAY)'
	$(BIN)/python -m pytest -m long --part $(DAY) --minutes 8 --timeout 900 --durations 20 $(PYTEST) || { \
		echo 'failed: a slow test that make test does not run. Again: make slow-part DAY=$(DAY)' >&2; exit 1; }

# iwer stands in for a headset.
IWER := $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/retarget/iwer-2.5.0

browser: $(VENV)/.with-test,browser
	@missing=0; for tool in chromium ffmpeg npm; do \
		command -v $$tool >/dev/null || command -v $$tool-browser >/dev/null || { missing=1; \
			echo "missing: $$tool" >&2; echo "   get it: Debian, Ubuntu: apt install $$tool; Fedora: dnf install $$tool" >&2; }; \
	done; exit $$missing
	$(BIN)/retarget web install
	[ -d '$(IWER)' ] || npm install --silent --no-save --ignore-scripts --prefix '$(IWER)' iwer@2.5.0
	RETARGET_IWER='$(IWER)/node_modules/iwer/build/iwer.min.js' $(BIN)/python -m pytest tests/web --timeout 0 -rs $(PYTEST)

lerobot: $(VENV)/.with-test $(LEROBOT)/.installed
	RETARGET_LEROBOT_PYTHON='$(abspath $(LEROBOT))/bin/python' $(BIN)/python -m pytest tests/lerobot --timeout 0 -rs $(PYTEST)

$(LEROBOT)/.installed: pyproject.toml $(PLUGIN)/pyproject.toml $(RUST)
	@[ -n '$(LEROBOT_PYTHON)' ] || { echo 'missing: Python 3.12 or 3.13, which LeRobot needs' >&2; \
		echo '   get it: Debian, Ubuntu: apt install python3.12 python3.12-venv; or make lerobot LEROBOT_PYTHON=PATH' >&2; exit 1; }
	$(LEROBOT_PYTHON) -m venv $(LEROBOT)
	$(LEROBOT)/bin/python -m pip install --quiet --upgrade 'pip>=24' 'maturin>=1.9,<2'
	PATH="$(abspath $(LEROBOT))/bin:$$PATH" $(LEROBOT)/bin/python -m pip install --quiet --no-build-isolation --editable '.[record]'
	$(LEROBOT)/bin/python -m pip install --quiet 'lerobot[core_scripts]>=0.6,<0.7' --editable ./$(PLUGIN)
	@touch $@

lint: $(VENV)/.with-test $(VENV)/.with-lint
	@cargo fmt --version >/dev/null 2>&1 && cargo clippy --version >/dev/null 2>&1 || { echo 'missing: rustfmt or clippy' >&2; \
		echo '   get them: rustup component add rustfmt clippy; or Debian, Ubuntu: apt install rustfmt rust-clippy' >&2; exit 1; }
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	cargo fmt --check --manifest-path $(MANIFEST)
	PYO3_PYTHON=$(abspath $(BIN)/python) cargo clippy --release --locked --all-targets --all-features --quiet --manifest-path $(MANIFEST) -- -D warnings

golden: $(VENV)/.with-test
	@[ -n '$(AGAINST)' ] || { echo 'which commit? make golden AGAINST=HEAD' >&2; exit 2; }
	$(BIN)/python -m benchmarks.golden --against '$(AGAINST)' --jobs $(JOBS) $(GOLDEN)

golden-store: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.golden --store

same-bits: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.same_bits --jobs $(JOBS) $(BITS)

docs: $(VENV)/.with-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict
	@echo 'open out/site/index.html'

docs-tables: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.docs_tables

bench: $(VENV)/.with-bench
	$(BIN)/python -m benchmarks $(BENCH)

bench-bus: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.bus $(BENCH)

bench-tick: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.tick_cost $(BENCH)

bench-latency: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.latency $(BENCH)

bench-lateness: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.lateness $(BENCH)

bench-viewer: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.viewer $(BENCH)

bench-physics: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.physics $(BENCH)

paper: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.paper $(BENCH)

gallery: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.gallery

pictures: $(VENV)/.with-test,browser
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || { echo 'missing: chromium' >&2; \
		echo '   get it: Debian, Ubuntu: apt install chromium; Fedora: dnf install chromium' >&2; exit 1; }
	$(BIN)/python -m benchmarks.pictures $(PICTURES)

robustness: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.robustness --jobs $(JOBS) $(BENCH)

mutants: $(VENV)/.with-test
	$(BIN)/python tests/support/mutants.py $(MUTANTS)

fuzz: $(VENV)/.with-test
	$(BIN)/python -m benchmarks.fuzz --cases $(or $(N),100000) --jobs $(JOBS) $(FUZZ)

# Ready to publish: the wheels, and the sdist for every other machine, have run the first lines of the README.
# zig links against an old glibc (2.17), for machines older than this one and for the other architecture.
wheels: $(VENV)/.pip
	@command -v rustup >/dev/null || { echo 'make wheels needs rustup, to add the standard library of both' \
		'architectures: https://rustup.rs (a cargo from a system package has only its own)' >&2; exit 1; }
	rustup target add $(RUST_TARGETS)
	$(BIN)/python -m pip install --quiet 'ziglang>=0.13'
	rm -rf wheels
	$(BIN)/maturin sdist --out wheels
	for target in $(RUST_TARGETS); do \
		PATH="$(abspath $(BIN)):$$PATH" $(BIN)/maturin build --release --locked --zig --target $$target \
			--compatibility manylinux2014 --interpreter $(abspath $(BIN)/python) --out wheels || exit 1; \
	done
	$(BIN)/python -m benchmarks.wheels wheels

clean:
	rm -rf $(VENV) $(LEROBOT) $(CRATE)/target wheels out .pytest_cache .mypy_cache .ruff_cache .hypothesis
	rm -f retarget/_solver*.so
	find retarget hardware sim tests benchmarks examples docs -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

# One stamp per set of dependencies. A change of the crate or of pyproject.toml builds the extension (release) and installs again.
$(VENV)/.with-%: pyproject.toml $(RUST) | $(VENV)/.pip
	@echo 'Compiling the solver and installing what the program needs: a minute or two, once.'
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python -m pip install --quiet --no-build-isolation --editable '.$(if $(filter base,$*),,[$*])'
	@$(BIN)/python -m compileall -q retarget hardware sim
	@touch $@

$(VENV)/.pip: | machine
	@echo 'Making $(VENV), with pip and maturin.'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=24' 'maturin>=1.9,<2'
	@touch $@

machine:
	@missing=0; \
	say() { echo "missing: $$1" >&2; echo "   get it: $$2" >&2; missing=1; }; \
	if [ -z "$(PYTHON)" ]; then \
		say 'Python 3.11 or newer' 'Debian, Ubuntu: apt install python3 python3-venv; or make PYTHON=/path/to/python3.12'; \
	elif ! "$(PYTHON)" -c 'import venv, ensurepip' 2>/dev/null; then \
		say "the venv module of $(PYTHON)" 'Debian, Ubuntu: apt install python3-venv'; \
	fi; \
	command -v cc >/dev/null || say 'a C linker (cc)' 'Debian, Ubuntu: apt install gcc; Fedora: dnf install gcc'; \
	if ! command -v cargo >/dev/null; then \
		say 'cargo (Rust $(RUST_OLDEST) or newer)' 'https://rustup.rs; a package of the system may be too old'; \
	else \
		found=$$(cargo --version | cut -d' ' -f2); \
		[ "$$(printf '%s\n' $(RUST_OLDEST) "$$found" | sort -V | head -n1)" = $(RUST_OLDEST) ] || \
			say "Rust $(RUST_OLDEST) or newer (found $$found)" 'rustup update, or https://rustup.rs'; \
	fi; \
	[ $$missing -eq 0 ]
