# Two commands do everything on a fresh Debian 12 with Rust:
#   make demo   the main job on the simulated cell
#   make test   every check
# Both install the system packages they need with apt (as root, or through sudo) when they are missing.

PACKAGES = libopencv-dev clang libclang-dev pkg-config
SUDO = $(shell [ "$$(id -u)" = 0 ] || echo sudo)

.PHONY: demo test packages bench

packages:
	@dpkg -s $(PACKAGES) >/dev/null 2>&1 || { \
	  echo "installing with apt: $(PACKAGES)"; \
	  $(SUDO) apt-get update -qq && $(SUDO) apt-get install -y --no-install-recommends $(PACKAGES) >/dev/null; }

demo: packages
	cargo run --locked --bin cellcal -- run cells/sim.yaml --time-scale max --output sessions/demo

test: packages
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	cargo test --locked
