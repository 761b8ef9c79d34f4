#!/bin/sh
# Installs what a run needs on Debian or Ubuntu: the Vulkan loader, lavapipe where no hardware driver is there, the bunny,
# and valgrind, which counts instructions in comparisons of builds (without it that gate is skipped and says so).
# With `test`: also SwiftShader, the second software driver that the tests use, Vulkan's validation layer, Chromium with axe-core for
# the tests of the HTML page, PyYAML and shellcheck for those of jobs, the validator of records, pandas and polars for those of cells.csv, and what builds the worker in C++. Elsewhere it only says what it would do.
set -eu

if ! command -v cargo >/dev/null 2>&1; then
    echo "error: cargo is missing: install Rust (rustup.rs) first" >&2
    exit 2
fi
if ! command -v apt-get >/dev/null 2>&1; then
    echo "note: no apt-get here; a Vulkan loader and driver (or Metal, or Direct3D 12) must be installed already" >&2
    exit 0
fi

axe_version=4.14.1
pandas_version=2.2.3
polars_version=1.9.0
missing=""
want() { # package
    dpkg-query -W -f '${Status}' "$1" 2>/dev/null | grep -q '^install ok installed' || missing="$missing $1"
}
hardware_driver() {
    [ -e /dev/nvidia0 ] || ls /dev/dri/renderD* >/dev/null 2>&1
}

want libvulkan1
hardware_driver || want mesa-vulkan-drivers
want glmark2-data
want valgrind
[ "${1:-}" != test ] || {
    want mesa-vulkan-drivers; want chromium-common
    want vulkan-validationlayers
    want chromium; want chromium-driver
    want g++; want make; want libvulkan-dev; want glslang-tools; want nlohmann-json3-dev
    want python3-yaml; want python3-jsonschema; want python3-pip; want shellcheck
}

install() {
    [ -n "$missing" ] || return 0
    sudo=""
    [ "$(id -u)" = 0 ] || sudo="sudo"
    echo "installing:$missing"
    $sudo apt-get update -qq
    # shellcheck disable=SC2086
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq --no-install-recommends $missing >/dev/null
}
# The accessibility checks that the page's tests run in Chromium.
install_npm() {
    modules=target/npm/node_modules
    [ ! -e $modules/axe-core/axe.min.js ] || return 0
    untested="the page's accessibility is not tested"
    command -v npm >/dev/null 2>&1 || { echo "note: no npm, so $untested" >&2; return 0; }
    npm install --silent --no-save --prefix target/npm "axe-core@$axe_version" >/dev/null ||
        echo "note: the npm package could not be installed, so $untested" >&2
}

# The libraries that tests/nightly/cells.py reads cells.csv with.
install_python() {
    [ ! -d target/python/polars ] || return 0
    PIP_ROOT_USER_ACTION=ignore /usr/bin/python3 -m pip install --quiet --target target/python "pandas==$pandas_version" "polars==$polars_version" ||
        echo "note: pandas and polars could not be installed, so cells.csv is not tested with them" >&2
}

install
if [ "${1:-}" = test ]; then
    install_npm
    install_python
fi
