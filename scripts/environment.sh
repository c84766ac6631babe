# Functions for scripts/demo, scripts/test and others, which source this file: create .venv and install the package, on a
# plain Debian or Ubuntu with python3 (3.10 or later), its venv module and git, as an ordinary user. Nothing outside this
# folder is changed.

cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1

fail() {
    echo "$(basename "$0"): $*" >&2
    exit 1
}

# Unpack Debian packages below .venv/debian: needs apt-get, but neither root nor changes to the system.
unpack_debian() {
    command -v apt-get > /dev/null && command -v dpkg-deb > /dev/null || return 1
    local work="$PWD/.venv/debian" package
    local apt=(apt-get -qq -o "Dir::State::lists=$work/lists" -o "Dir::Cache=$work/cache" -o APT::Sandbox::User=)
    mkdir -p "$work/lists/partial" "$work/cache/archives/partial"
    [ -n "$(ls "$work"/lists/*Packages* 2> /dev/null)" ] || "${apt[@]}" update > /dev/null 2>&1 || return 1
    for package in "$@"; do
        (cd "$work/cache" && "${apt[@]}" download "$package" > /dev/null 2>&1) || return 1
    done
    for package in "$work"/cache/*.deb; do
        dpkg-deb -x "$package" "$work" && rm "$package" || return 1
    done
}

# The lcm wheel uses the system's GLib, which a plain system may lack.
provide_glib() {
    local library
    for library in "$PWD"/.venv/debian/usr/lib/*-linux-gnu "$PWD"/.venv/debian/lib/*-linux-gnu; do
        [ -d "$library" ] && export LD_LIBRARY_PATH="$library${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
    done
    .venv/bin/python -c 'import ctypes; ctypes.CDLL("libglib-2.0.so.0")' 2> /dev/null && return
    [ -z "${GLIB_TRIED:-}" ] || fail "LCM needs the library libglib-2.0.so.0: sudo apt-get install libglib2.0-0"
    GLIB_TRIED=1
    echo "Fetching GLib, which LCM needs (to install it for all users: sudo apt-get install libglib2.0-0) ..."
    unpack_debian libglib2.0-0 || unpack_debian libglib2.0-0t64
    provide_glib
}

# Create .venv and install the package with the extras $1, unless that has been done for this pyproject.toml.
provide_environment() {
    local extras="$1" stamp
    command -v python3 > /dev/null || fail "python3 is missing: sudo apt-get install python3 python3-venv"
    python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' || fail "Python 3.10 or later is needed; this is $(python3 --version)"
    if [ ! -x .venv/bin/pip ]; then
        python3 -m venv .venv || fail "the venv module is missing: sudo apt-get install python3-venv"
    fi
    provide_glib
    stamp="$(cat pyproject.toml lcmtypes/*.lcm scripts/build_*.py | sha256sum) $PWD"
    if [ "$(cat ".venv/installed$extras" 2> /dev/null)" != "$stamp" ]; then
        echo "Installing into .venv ..."
        # The package was named "cmr" until 25 November 2026; both would install the same commands.
        .venv/bin/pip uninstall --quiet --yes cmr > /dev/null 2>&1
        # Python compiles modules when they are imported; compiling everything now would take twenty seconds.
        .venv/bin/pip install --quiet --no-compile --editable ".$extras" || fail "pip could not install the package; see above"
        echo "$stamp" > ".venv/installed$extras"
    fi
}

# Create .venv/ros2 with rclpy from the package index and everything in .venv, unless that has been done for this
# pyproject.toml. Fails if there are no wheels for this computer, or if the installation takes more than $1 seconds.
provide_ros2() {
    local stamp command
    stamp="$(sha256sum pyproject.toml) $PWD"
    [ "$(cat .venv/ros2/installed 2> /dev/null)" != "$stamp" ] || return 0
    .venv/bin/python -m venv --clear .venv/ros2 || return 1
    .venv/bin/python -c 'import os, sysconfig; print(sysconfig.get_path("purelib"), here := os.getcwd(), here + "/tools", sep="\n")' \
        > "$(.venv/ros2/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/cmr.pth" || return 1
    .venv/bin/python -c 'from setuptools.config.pyprojecttoml import read_configuration as read
print("\n".join(read("pyproject.toml", expand=False)["project"]["optional-dependencies"]["ros2"]))' \
        > .venv/ros2/requirements.txt || return 1
    timeout "$1" .venv/ros2/bin/pip install --quiet --no-compile --requirement .venv/ros2/requirements.txt || return 1
    .venv/ros2/bin/python -c 'import rclpy' || return 1
    for command in .venv/bin/cmr .venv/bin/cmr-*; do
        sed "1s|.*|#!$PWD/.venv/ros2/bin/python|" "$command" > ".venv/ros2/bin/${command##*/}" || return 1
        chmod +x ".venv/ros2/bin/${command##*/}"
    done
    echo "$stamp" > .venv/ros2/installed
}
