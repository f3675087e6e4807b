#!/bin/sh
# The pictures of the README and the docs. Usage: sh scripts/make_pictures.sh [RUN]
# RUN: a flown run folder; default: a fresh demo. Needs a Vulkan driver and Chromium
# (Debian, Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1 chromium).
set -eu
case "${1:-}" in "" | /*) run="${1:-}" ;; *) run="$(pwd)/$1" ;; esac
cd "$(dirname "$0")/.."
extra="dev"
. scripts/setup_env.sh
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
if [ -z "$run" ]; then
    run="$work/demo"
    "$venv/bin/uavcover" demo -o "$run"
fi
mkdir -p docs/pictures
"$venv/bin/uavcover" inspect "$run" --screenshot docs/pictures/demo-recording.png --at 0.55 --force
"$venv/bin/uavcover" report "$run" -o "$work/report.html"
"$venv/bin/python" scripts/picture_report.py "$work/report.html" docs/pictures
