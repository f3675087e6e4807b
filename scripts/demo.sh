#!/bin/sh
# The whole chain on real terrain: plan, upload to a mock vehicle, fly, record, verify.
# Usage: sh scripts/demo.sh [OUT_DIR]   (default: out)
set -eu
case "${1:-out}" in
    /*) out="${1:-out}" ;;
    *) out="$PWD/${1:-out}" ;;
esac
[ $# -gt 0 ] && shift
cd "$(dirname "$0")/.."
extra=""
. scripts/setup_env.sh
echo "demo: $venv/bin/uavcover demo -o $out $*"
exec "$venv/bin/uavcover" demo -o "$out" "$@"
