#!/usr/bin/env bash
# Try a fresh clone in a bare Debian 12: only git, make and pip in it, no display, nothing installed before.
#
#   scripts/bare.sh                      make setup, make setup, make run, make run, make test
#   scripts/bare.sh "make setup" ...     these commands, each timed
#
# Needs root and debootstrap. What is committed is tried, not the work tree. The bare system is made
# once and copied for every run; mounts live in a namespace of their own and end with it.
set -euo pipefail
cd "$(dirname "$0")/.."

BASE=${BARE_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/ascrcp-bare}
ROOT=$BASE/run
CERTIFICATES=etc/ssl/certs/ca-certificates.crt
[ $# -gt 0 ] || set -- "make setup" "make setup" "make run" "make run" "make test"

if [ ! -e "$BASE/base/etc/debian_version" ]; then
    mkdir -p "$BASE"
    rm -rf --one-file-system "$BASE/base.part"
    debootstrap --variant=minbase --include=git,make,python3,python3-pip,ca-certificates \
        bookworm "$BASE/base.part" >"$BASE/debootstrap.log"
    mv "$BASE/base.part" "$BASE/base"
fi
rm -rf --one-file-system "$ROOT"
cp -a "$BASE/base" "$ROOT"
cp -L /etc/resolv.conf "$ROOT/etc/resolv.conf"
cp -L "/$CERTIFICATES" "$ROOT/$CERTIFICATES"   # with those that the owner of this machine added
mkdir -p "$ROOT/src/shared"
git clone --quiet . "$ROOT/src/ascrcp"

pass=(PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8
    SSL_CERT_FILE="/$CERTIFICATES" PIP_CERT="/$CERTIFICATES")
for name in http_proxy https_proxy no_proxy HTTP_PROXY HTTPS_PROXY NO_PROXY; do
    [ -z "${!name:-}" ] || pass+=("$name=${!name}")
done

# shellcheck disable=SC2016  # expanded inside the namespace
inside='
root=$1 shared=$2; shift 2
peak=$root/peak measure=()
[ ! -x /usr/bin/time ] || measure=(/usr/bin/time -q -f %M -o "$peak")
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
[ ! -d "$shared" ] || mount --bind -o ro "$shared" "$root/src/shared"
status=0
for command in "$@"; do
    begin=$(date +%s%N)
    env -i "${pass[@]}" "${measure[@]}" chroot "$root" /bin/bash -c "cd /src/ascrcp && $command" </dev/null &&
        code=0 || code=$?
    echo "=== $command: exit $code, $((($(date +%s%N) - begin) / 1000000)) ms" \
        "$([ ! -s "$peak" ] || awk "{ printf \"largest process %d MB\", \$NF / 1024 }" "$peak")"
    [ $code = 0 ] || status=1
done
echo "=== disk: checkout with .venv $(du -sm "$root/src/ascrcp" | cut -f1) MB, whole root $(du -smx "$root" | cut -f1) MB"
exit $status'
unshare --mount --pid --fork bash -c "$(declare -p pass); $inside" bare "$ROOT" ../shared "$@"
