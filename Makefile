# Two commands do everything on a fresh Debian 12 with Rust:
#   make demo   the main job on the simulated cell
#   make test   every check
# Both install the system packages they need with apt (as root, or through sudo) when they are missing.

PACKAGES = libopencv-dev clang libclang-dev pkg-config
# What is checked and tested: all drivers.
FEATURES = genicam,evk4
# GenICam cameras, and a network of its own for the camera of the tests. The tests also look at the page of the target
# in a browser, at its videos and at its paper. Without those:
# make test CELLCAL_CHROMIUM=no CELLCAL_FFMPEG=no CELLCAL_PDFTOPPM=no
TEST_PACKAGES = libaravis-dev libusb-1.0-0-dev libxml2-dev iproute2 \
  $(if $(filter no,$(CELLCAL_CHROMIUM)),,chromium) $(if $(filter no,$(CELLCAL_FFMPEG)),,ffmpeg) \
  $(if $(filter no,$(CELLCAL_PDFTOPPM)),,poppler-utils)
export CELLCAL_CHROMIUM CELLCAL_FFMPEG CELLCAL_PDFTOPPM
SUDO = $(shell [ "$$(id -u)" = 0 ] || echo sudo)

# The tests drive the simulated controller with a client of others, in an environment of its own.
# Without access to PyPI: make test UR_RTDE=no
UR_RTDE = 1.6.5
CLIENT = $(CURDIR)/target/ur-rtde-$(UR_RTDE)

# The paper's pipeline in OpenCV-Python, in an environment of its own too: what our speed and accuracy are compared with.
BASELINE = target/baseline

.PHONY: demo test packages test-packages bench baseline

packages:
	@dpkg -s $(PACKAGES) >/dev/null 2>&1 || { \
	  echo "installing with apt: $(PACKAGES)"; \
	  $(SUDO) apt-get update -qq && $(SUDO) apt-get install -y --no-install-recommends $(PACKAGES) >/dev/null; }

test-packages: packages
	@dpkg -s $(TEST_PACKAGES) >/dev/null 2>&1 || { \
	  echo "installing with apt: $(TEST_PACKAGES)"; \
	  $(SUDO) apt-get update -qq && $(SUDO) apt-get install -y --no-install-recommends $(TEST_PACKAGES) >/dev/null; }

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

# Ready when it has solved synthetic corners of known cameras.
baseline: $(BASELINE)/ready

$(BASELINE)/ready: benches/baseline/requirements.txt
	@dpkg -s python3-venv >/dev/null 2>&1 || { \
	  echo "installing with apt: python3-venv"; \
	  $(SUDO) apt-get update -qq && $(SUDO) apt-get install -y --no-install-recommends python3-venv >/dev/null; }
	rm -rf $(BASELINE)
	/usr/bin/python3 -m venv $(BASELINE)
	$(BASELINE)/bin/pip install --quiet --disable-pip-version-check -r benches/baseline/requirements.txt
	PYTHONDONTWRITEBYTECODE=1 $(BASELINE)/bin/python benches/baseline/paper.py --self-check
	touch $@

# Robot time of the 39 poses against fixed waits, in controller time: the profile does not matter. Then the event
# decoders, optimised; with CELLCAL_DATA also on a real recording.
bench: packages
	cargo bench --locked --profile dev --bench session_time
	cargo bench --locked --bench decode
