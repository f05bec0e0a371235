#!/usr/bin/env bash
# Make a checkout ready to run: system packages, a private uv, .venv as uv.lock says. Safe to repeat.
#
# Needs only git, make and a pip. Nothing is installed outside this folder, but for the Debian
# packages below, and those only as root; otherwise one line names them.
set -euo pipefail
cd "$(dirname "$0")/.."

UV_VERSION=0.13.9      # writes and reads the revision of uv.lock that is committed
TOOLS=.tools           # private: uv and the stamp of the last set-up
UV=$TOOLS/bin/uv
STAMP=$TOOLS/stamp

# Qt without a display; Open3D; a GL window under a virtual display, drawn in software; Chinese text.
PACKAGES="libegl1 libgl1 libxkbcommon0 libdbus-1-3 libfontconfig1 libglib2.0-0
libgomp1 libusb-1.0-0 libx11-6
xvfb xauth libxcb-cursor0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-randr0 libxcb-render-util0
libxcb-shape0 libxcb-xkb1 libxkbcommon-x11-0 libgl1-mesa-dri
fonts-wqy-microhei"

say() { echo "setup: $*" >&2; }

die() {
    say "$@"
    exit 1
}

# Print the packages of PACKAGES that this Debian lacks; nothing where there is no dpkg.
missing_packages() {
    command -v dpkg-query >/dev/null || return 0
    local have name
    # "t64" ends the names of some of them in the releases after Debian 12
    have=$(dpkg-query -W -f '${db:Status-Status} ${Package}\n' | sed -n 's/^installed //p' | sed 's/t64$//')
    for name in $PACKAGES; do
        grep -qxF "$name" <<<"$have" || echo "$name"
    done
}

apt_install() {
    local log=$TOOLS/apt.log
    say "apt-get install" "$@"
    if ! { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@"; } \
        >"$log" 2>&1 </dev/null; then
        tail -n 5 "$log" >&2
        return 1
    fi
}

install_packages() {
    local missing
    missing=$(missing_packages | tr '\n' ' ')
    [ -n "$missing" ] || return 0
    # shellcheck disable=SC2086  # a list of words
    if [ "$(id -u)" != 0 ]; then
        say "not root; if the screen does not start: sudo apt-get install" $missing
    elif ! apt_install $missing; then
        say "could not install these packages; the screen may not start:" $missing
    fi
}

# Print the path of a Python that pyproject.toml allows, the first choice 3.11.
find_python() {
    local name found
    for name in "${PYTHON:-}" python3.11 /usr/bin/python3.11 "$HOME"/.pyenv/versions/3.11.*/bin/python3.11 \
        python3.12 python3 python; do
        [ -n "$name" ] || continue
        found=$("$name" -c '
import os, sys
if (3, 11) <= sys.version_info < (3, 13):
    print(os.path.realpath(sys.executable))' 2>/dev/null </dev/null) || continue
        [ -z "$found" ] || { echo "$found"; return 0; }
    done
    return 1
}

# Put uv into TOOLS. "--target" needs neither venv nor ensurepip and leaves an externally managed Python alone.
install_uv() {
    [ "$("$UV" --version 2>/dev/null | cut -d' ' -f2)" != "$UV_VERSION" ] || return 0
    local pip
    for pip in "$1 -m pip" pip3 pip; do
        $pip --version >/dev/null 2>&1 || continue
        say "uv $UV_VERSION"
        rm -rf "${TOOLS:?}"/bin "$TOOLS"/uv*
        if PIP_USER=0 PIP_NO_INPUT=1 $pip install --quiet --disable-pip-version-check --no-deps --upgrade \
            --target "$TOOLS" "uv==$UV_VERSION" && [ -x "$UV" ]; then
            return 0
        fi
    done
    die "no pip here could fetch uv $UV_VERSION (tried python -m pip, pip3, pip)"
}

# Make .venv what uv.lock says. Files and hashes come from the lock, so no index is asked.
sync() {
    export UV_PYTHON_DOWNLOADS=never UV_PROJECT_ENVIRONMENT=.venv UV_HTTP_TIMEOUT=180
    # a certificate that the machine's owner added to the system's store counts, as it does for pip
    if [ -s /etc/ssl/certs/ca-certificates.crt ]; then
        export UV_SYSTEM_CERTS=true
    fi
    # scripts in a .venv start with its path: one that was moved or copied here is made anew
    if ! head -c 400 .venv/bin/ascrcp 2>/dev/null | grep -qF "$PWD/.venv/" ||
        ! .venv/bin/python -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 13))' 2>/dev/null; then
        "$UV" venv --quiet --no-project --clear --python "$1" .venv
    fi
    # compiled here, once: a cab's start does not wait for it, nor does a read-only or PYTHONDONTWRITEBYTECODE one
    "$UV" sync --frozen --no-progress --quiet --compile-bytecode --python .venv/bin/python
    .venv/bin/python -m compileall -q ascrcp
    say "machine code of the solver (half a minute)"
    .venv/bin/python -c "from ascrcp.kinematics.kernel_call import load_kernels; load_kernels()"
}

mkdir -p "$TOOLS"
exec 9>"$TOOLS/lock"
command -v flock >/dev/null && flock 9   # two at once: the second waits, then finds the work done

# The folder is part of the stamp: a .venv holds absolute paths and does not survive being moved.
stamp=$(cat uv.lock pyproject.toml scripts/setup.sh <(pwd) | sha256sum | cut -d' ' -f1)
if [ "$(cat "$STAMP" 2>/dev/null)" = "$stamp" ] && [ -x .venv/bin/ascrcp ]; then
    exit 0
fi

install_packages
if ! python=$(find_python); then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null && apt_install python3; then
        python=$(find_python) || die "this system's python3 is neither 3.11 nor 3.12; set PYTHON=/path/to/python3.11"
    else
        die "needs Python 3.11 or 3.12: install it, or set PYTHON=/path/to/python3.11"
    fi
fi
install_uv "$python"
say "packages of uv.lock into .venv (Python at $python)"
sync "$python"
echo "$stamp" >"$STAMP"
