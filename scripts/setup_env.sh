# Sourced by demo.sh and test.sh: makes .venv when there is none and brings it up to the pins of constraints.txt.
# Usage: extra=dev; . scripts/setup_env.sh     (extra: an optional-dependency group of pyproject.toml, or empty)
# Leaves $venv set to the environment's folder. Needs python3 >= 3.11 and, for a first set-up, the package index.
set -eu

extra="${extra:-}"
venv="${UAVCOVER_VENV:-.venv}"
python="${PYTHON:-python3}"

if [ -x "$venv/bin/python" ]; then
    echo "set-up: re-using $venv"
else
    command -v "$python" >/dev/null 2>&1 || { echo "set-up: no $python found; install Python 3.11 or newer, or set PYTHON" >&2; exit 2; }
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
        echo "set-up: $("$python" --version) is too old; uavcover needs Python 3.11 or newer (set PYTHON to one)" >&2; exit 2; }
    echo "set-up: making $venv with $("$python" --version)"
    "$python" -m venv "$venv" || {
        echo "set-up: could not make $venv; on Debian and Ubuntu: apt install python3-venv" >&2; rm -rf "$venv"; exit 2; }
fi

# What is installed is remembered by a checksum, so that a second run starts at once and offline.
stamp="$venv/.uavcover-setup${extra:+-$extra}"
wanted="$(cat pyproject.toml constraints.txt | cksum)"
if [ "$(cat "$stamp" 2>/dev/null || true)" != "$wanted" ]; then
    echo "set-up: installing the pinned dependencies${extra:+ with extra '$extra'} (1 to 3 minutes the first time)"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -c constraints.txt hatchling editables
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-build-isolation -c constraints.txt -e ".${extra:+[$extra]}"
    echo "$wanted" > "$stamp"
fi

# The numeric kernels are compiled once, here, so that no search and no test waits for it; their machine code is kept by a
# checksum of their sources.
kernels="$venv/.uavcover-kernels"
sources="$(cat uavcover/kernels/*.py uavcover/extras/bounds/*.py | cksum)"
if [ "$(cat "$kernels" 2>/dev/null || true)" != "$sources" ]; then
    echo "set-up: compiling the numeric kernels (2 to 4 minutes the first time)"
    "$venv/bin/uavcover" doctor --compile -q
    echo "$sources" > "$kernels"
fi
