# The doors of this project; `make` alone lists them.

CARGO ?= cargo
# `demo` and `test` can be built alike with PROFILE=ci, so that nothing is built twice.
PROFILE ?=
# With NumPy (scripts/requirements.txt), where `make test` has installed it.
PYTHON ?= $(if $(wildcard .venv/bin/python),.venv/bin/python,python3)

.PHONY: help build wheel windows demo paper real study fuzz release release-check soak package deny licences test check bench results book clean

help: ## List what make can do (the default)
	@sed -n 's/^\([a-z-]*\):.*## /make \1\t/p' $(MAKEFILE_LIST) | expand -t 20

build: ## Build target/release/quadrille
	$(CARGO) build --release --locked

wheel: ## Build the wheel of Python, try it in a fresh environment, run its tests; in out/wheel (WHEEL=--zig for glibc 2.28)
	PROFILE=$(or $(PROFILE),release) scripts/wheel.sh $(WHEEL)

windows: ## Cross-compile quadrille.exe and let it correlate a pair under wine (where it is there)
	scripts/windows.sh --profile $(or $(PROFILE),release)

# PROGRAM names one that is built.
demo: ## From 20 images of a virtual test to the law of its adhesive; results in out/demo
	$(or $(PROGRAM),$(CARGO) run --profile $(or $(PROFILE),release) --locked --) demo --output out/demo

paper: ## Tables and figures of Fedele et al. (2009) done again; in out/paper
	$(CARGO) run --release --locked -p quadrille-testbed -- paper --overwrite --output out/paper

real: ## The first command, no option, on every set of images in the folder DATA=...; a table, results in out/first
	@test -d "$(DATA)" || { echo "name a folder whose subfolders hold images: make real DATA=folder" >&2; exit 2; }
	$(CARGO) build --release --locked
	scripts/first_command.py "$(DATA)" --output out/first

test: ## Install what tests need where it may, then run the tests (the long ones: release-check)
	scripts/test.sh --profile $(or $(PROFILE),dev)

study: ## Uncertainty, identification over many seeds and draws, obstacles, for the tables of the documents (about two hours); in out/study
	$(CARGO) test --release --locked --test correlation -- uncertainty:: noise_model:: engine:: --ignored --nocapture
	$(CARGO) test --release --locked --test identification -- identify:: intervals:: several_tests:: --ignored --nocapture
	$(CARGO) build --release --locked
	scripts/study.py --output out/study
	scripts/bands.py --output out/study/bands
	scripts/doubt.py --output out/study/doubt
	scripts/rotations.py --output out/study/rotations
	$(PYTHON) scripts/obstacles.py --output out/study/obstacles
	scripts/tournament.py --output out/study/tournament
	scripts/beams.py --output out/study/beams
	scripts/soak.py --output out/study/soak
	scripts/drivers.sh --long --release
	scripts/flicker.py --output out/study/flicker
	-$(PYTHON) scripts/verdicts.py --out out/study/verdicts.md
	-$(PYTHON) scripts/status.py
	-$(PYTHON) scripts/camera.py
	-scripts/reduction.py --output out/study/reduction
	-scripts/constants.py

fuzz: ## Attack all readers of files, guided by coverage, SECONDS=3600 for each; findings in out/fuzz
	scripts/fuzz.sh $(or $(SECONDS),3600)

release: ## Archives, wheels, checksums, bills of materials and notes; in out/release (PARTS="sbom notes" for some)
	scripts/release.sh $(PARTS)

release-check: ## What is long and seldom tells more (PARTS="miri wheel" for some; scripts/release-check.sh lists them)
	scripts/release-check.sh $(PARTS)

soak: ## Long and hostile runs: every write that fails, 100 000 frames with kills, memory that ends (an hour or two); in out/soak
	$(CARGO) build --release --locked
	scripts/soak.py --output out/soak

package: ## Pack the crates as crates.io would get them, look into them, and compile them from that alone
	scripts/package.sh

deny: ## Check licences, sources, banned and duplicate crates and advisories (deny.toml), and that the third-party notices are current
	scripts/deny.sh advisories

licences: ## Write the third-party notices that the program prints (after a change of its crates)
	scripts/licences.py

check: ## Formatting, lints, documentation: all without a warning
	$(CARGO) fmt --all --check
	$(CARGO) clippy --workspace --all-targets --locked -- -D warnings
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --no-deps --locked

book: ## The book of docs/, in out/book/index.html
	scripts/prepare.sh --python
	.venv/bin/python scripts/book.py build

bench: ## Run the benchmarks
	$(CARGO) bench --locked -p quadrille-testbed

results: ## Measure, and write benches/RESULTS.md (ONLY=pairs,kernels: these sections alone; on a quiet machine)
	scripts/results.py $(if $(ONLY),--only $(ONLY)) $(if $(DATA),--data "$(DATA)")

clean: ## Remove what was built and made: target, out, .venv
	$(CARGO) clean
	rm -rf out .venv
