#!/bin/sh
# The pictures of the README and the docs, from a fresh demo run. Usage: sh scripts/make_pictures.sh
# Needs a Vulkan driver for the picture of the recording (Debian, Ubuntu: apt install mesa-vulkan-drivers libvulkan1).
set -eu
cd "$(dirname "$0")/.."
extra=""
. scripts/setup_env.sh
run="$(mktemp -d)/demo"
trap 'rm -rf "$(dirname "$run")"' EXIT
"$venv/bin/uavcover" demo -o "$run"
mkdir -p docs/pictures
"$venv/bin/uavcover" inspect "$run" --screenshot docs/pictures/demo-recording.png --force
