# `make bench` builds and runs the main job; `make test` checks everything. Both set themselves up.
.PHONY: bench test setup setup-test

# The program is run from where it is built to, whatever the environment says of cargo's folders.
bench: setup
	env -u CARGO_BUILD_TARGET cargo build --release --locked --target-dir target
	target/release/fathom fetch || echo "note: scenes whose meshes are absent use their stand-ins"
	target/release/fathom run

# A build from nothing is faster without what a second one would reuse.
test: export CARGO_INCREMENTAL = 0
# Some tests wait, for a batch system or for a limit of time: others run beside them.
test: export RUST_TEST_THREADS ?= 4
test: setup-test
	cargo fmt --all --check
	scripts/licences.sh
	cargo clippy --locked --workspace --all-targets -- -D warnings
	cargo test --locked --workspace
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps

setup:
	scripts/setup.sh

setup-test:
	scripts/setup.sh test
