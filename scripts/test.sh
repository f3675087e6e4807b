#!/bin/sh
# Every gate, then the tests. Usage: sh scripts/test.sh [PYTEST_ARGS]
# With PYTEST_ARGS only the set-up and pytest with these arguments run, without the coverage gate.
set -eu
cd "$(dirname "$0")/.."
extra=dev
. scripts/setup_env.sh
bin="$venv/bin"
# One thread per process: the machines are small and BLAS threads fight each other.
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1

if [ $# -gt 0 ]; then
    exec "$bin/python" -m pytest "$@"
fi

# What is compiled once is not compiled by every test process; a core is free for it while the other one looks at types.
scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT
{
    "$bin/uavcover" demo -q -o "$scratch/demo" --evaluations 40 --speed 100
    "$bin/uavcover" plan paper-R2 -q -o "$scratch/paper" --evaluations 100
} &
compiling=$!
echo "gate: ruff"
"$bin/ruff" check .
"$bin/ruff" format --check .
echo "gate: mypy --strict"
"$bin/mypy"
echo "gate: import contracts"
"$bin/lint-imports"
wait "$compiling"

# A test file stays in one process: what its tests share is made once. tests/conftest.py puts the long ones first.
parallel="-n auto --dist loadfile --no-loadscope-reorder"
# Tracing every line makes a test take three times as long: only what the gates below ask for is measured.
measured="tests/planning tests/kernels tests/optimizers tests/coverage tests/mission_io"
echo "gate: tests of mission_io and of the planner's core"
rm -f .coverage .coverage.*
"$bin/python" -m pytest -q $parallel --cov --cov-report= $measured
echo "gate: tests of all the rest: commands, whole flights, set-up"
"$bin/python" -m pytest -q $parallel $(printf -- '--ignore=%s ' $measured)
echo "gate: tests of the kernels, JIT off, so that their coverage can be measured"
NUMBA_DISABLE_JIT=1 "$bin/python" -m pytest -q $parallel --cov --cov-append --cov-report= tests/kernels
echo "gate: branch coverage: 95 % of mission_io, 90 % of the planner's core"
"$bin/coverage" report --include='mission_io/*' --fail-under=95
"$bin/coverage" report --include='uavcover/planning/*,uavcover/optimizers/*,uavcover/coverage/*,uavcover/kernels/*' --fail-under=90
