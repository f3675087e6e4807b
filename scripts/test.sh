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

echo "gate: ruff"
"$bin/ruff" check .
"$bin/ruff" format --check .
echo "gate: mypy --strict"
"$bin/mypy"
echo "gate: import contracts"
"$bin/lint-imports"
# A test file stays in one process: what its tests share is made once.
parallel="-n auto --dist loadfile"
# Whole flights, and set-ups in processes of their own, are not measured: tracing every line slows a flying vehicle down.
whole="tests/cli tests/test_pipeline.py tests/test_setup.py tests/test_wheel.py sitl_tests"
echo "gate: tests"
rm -f .coverage .coverage.*
"$bin/python" -m pytest -q $parallel --cov --cov-report= $(printf -- '--ignore=%s ' $whole)
echo "gate: tests of commands, whole flights and set-up"
"$bin/python" -m pytest -q $parallel $whole
echo "gate: tests of the kernels and what stands on them, JIT off, so that their coverage can be measured"
NUMBA_DISABLE_JIT=1 "$bin/python" -m pytest -q $parallel --cov --cov-append --cov-report= tests/kernels
echo "gate: branch coverage: 95 % of mission_io, 90 % of the planner's core"
"$bin/coverage" report --include='mission_io/*' --fail-under=95
"$bin/coverage" report --include='uavcover/planning/*,uavcover/optimizers/*,uavcover/coverage/*,uavcover/kernels/*' --fail-under=90
