#!/bin/sh
# Installs the system packages that the tests on real pictures and videos need (Debian and its relatives). The build itself needs
# none; --all adds those of the feature `opencv`. Safe to run again.
set -eu

packages="visp-images-data ffmpeg"
case ${1:-} in
    "") ;;
    --all) packages="$packages libopencv-dev clang libclang-dev pkgconf" ;;
    *)
        echo "usage: ./setup.sh [--all]" >&2
        exit 2
        ;;
esac

if ! command -v apt-get >/dev/null 2>&1 || ! command -v dpkg-query >/dev/null 2>&1; then
    echo "setup: no apt here; for the tests on real pictures install the contents of: $packages"
    echo "setup: and set VISP_IMAGES to its folder ViSP-images"
    exit 0
fi

missing=""
for package in $packages; do
    status=$(dpkg-query -W -f='${db:Status-Abbrev}' "$package" 2>/dev/null) || status=""
    case $status in
        ii*) echo "setup: $package is installed" ;;
        *) missing="$missing $package" ;;
    esac
done
if [ -z "$missing" ]; then
    echo "setup: nothing to do"
    exit 0
fi

as_root=""
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null 2>&1; then
        echo "setup: neither root nor sudo; as root run: apt-get install$missing" >&2
        exit 1
    fi
    as_root="sudo"
fi
echo "setup: installing$missing"
$as_root apt-get update
# shellcheck disable=SC2086 # a list of words
$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $missing
echo "setup: installed$missing"
