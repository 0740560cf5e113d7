# Two commands do everything on a fresh Debian 12 with Rust:
#   make demo   the main job on the simulated cell
#   make test   every check
# Both install the system packages they need with apt (as root, or through sudo) when they are missing.

PACKAGES = libopencv-dev clang libclang-dev pkg-config
# GenICam cameras, and a network of its own for the camera of the tests.
GENICAM_PACKAGES = libaravis-dev libusb-1.0-0-dev libxml2-dev iproute2
# What is checked and tested: all drivers.
FEATURES = genicam
SUDO = $(shell [ "$$(id -u)" = 0 ] || echo sudo)

# The tests drive the simulated controller with a client of others, in an environment of its own.
# Without access to PyPI: make test UR_RTDE=no
UR_RTDE = 1.6.5
CLIENT = $(CURDIR)/target/ur-rtde-$(UR_RTDE)

.PHONY: demo test packages test-packages bench

packages:
	@dpkg -s $(PACKAGES) >/dev/null 2>&1 || { \
	  echo "installing with apt: $(PACKAGES)"; \
	  $(SUDO) apt-get update -qq && $(SUDO) apt-get install -y --no-install-recommends $(PACKAGES) >/dev/null; }

test-packages: packages
	@dpkg -s $(GENICAM_PACKAGES) >/dev/null 2>&1 || { \
	  echo "installing with apt: $(GENICAM_PACKAGES)"; \
	  $(SUDO) apt-get update -qq && $(SUDO) apt-get install -y --no-install-recommends $(GENICAM_PACKAGES) >/dev/null; }

demo: packages
	cargo run --locked --bin cellcal -- run cells/sim.yaml --time-scale max --output sessions/demo

test: test-packages
	cargo fmt --check
	cargo clippy --locked --all-targets --features $(FEATURES) -- -D warnings
	cargo clippy --locked -- -D warnings
ifeq ($(UR_RTDE),no)
	cargo test --locked --features $(FEATURES)
else
	$(MAKE) $(CLIENT)/ready
	CELLCAL_UR_RTDE_PYTHON=$(CLIENT)/bin/python cargo test --locked --features $(FEATURES)
endif

$(CLIENT)/ready:
	@dpkg -s python3-venv >/dev/null 2>&1 || { \
	  echo "installing with apt: python3-venv"; \
	  $(SUDO) apt-get update -qq && $(SUDO) apt-get install -y --no-install-recommends python3-venv >/dev/null; }
	rm -rf $(CLIENT)
	/usr/bin/python3 -m venv $(CLIENT)
	$(CLIENT)/bin/pip install --quiet --disable-pip-version-check ur-rtde==$(UR_RTDE)
	touch $@

# Robot time of the 39 poses against fixed waits, in controller time: the profile does not matter.
bench: packages
	cargo bench --locked --profile dev --bench session_time
