# `make bench` builds and runs the main job; `make test` checks a change; `make test-all` checks a release. Each sets itself up.
.PHONY: bench test test-all setup setup-all

# The program is run from where it is built to, whatever the environment says of cargo's folders.
bench: setup
	env -u CARGO_BUILD_TARGET cargo build --release --locked --target-dir target
	target/release/fathom fetch || echo "note: scenes whose meshes are absent use their stand-ins"
	target/release/fathom run

# A build from nothing is faster without what a second one would reuse.
test test-all: export CARGO_INCREMENTAL = 0
# Some tests wait for a limit of time: others run beside them.
test test-all: export RUST_TEST_THREADS ?= 4
test: setup
	cargo fmt --all --check
	scripts/weight.sh
	cargo test --locked --workspace --tests

# With lints, documents, licences, and what needs more than a software driver. What is missing fails.
test-all: export FATHOM_DRAWS = 100
test-all: export FATHOM_FUZZ_CASES = 1000
test-all: setup-all
	cargo fmt --all --check
	scripts/weight.sh
	scripts/licences.sh
	cargo clippy --locked --workspace --all-targets --features nightly -- -D warnings
	cd examples/vello_frames && cargo fmt --check && cargo clippy --locked --target-dir ../../target/vello_frames -- -D warnings
	cargo test --locked --workspace --features nightly
	/usr/bin/python3 tests/nightly/schema.py
	/usr/bin/python3 tests/nightly/cells.py target/debug/fathom
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps

setup:
	scripts/setup.sh

setup-all:
	scripts/setup.sh test
