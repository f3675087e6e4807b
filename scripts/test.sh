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
# The tests start hundreds of processes: with PYTHONDONTWRITEBYTECODE each would compile all our sources again.
unset PYTHONDONTWRITEBYTECODE

if [ $# -gt 0 ]; then
    exec "$bin/python" -m pytest "$@"
fi

scratch="$(mktemp -d)"
background=""
trap 'kill $background 2>/dev/null || true; rm -rf "$scratch"' EXIT
trap 'exit 130' INT TERM

# mypy takes as long as the other gates together: side by side.
echo "gate: mypy --strict"
"$bin/mypy" > "$scratch/mypy" 2>&1 &
background="$!"
echo "gate: ruff"
"$bin/ruff" check .
"$bin/ruff" format --check .
echo "gate: import contracts"
"$bin/lint-imports"
echo "gate: documentation"
NO_MKDOCS_2_WARNING=1 "$bin/python" -m mkdocs build --strict --quiet -d "$scratch/site"
wait "$background" || { cat "$scratch/mypy"; exit 1; }
cat "$scratch/mypy"

# A test file stays in one process: what its tests share is made once. tests/conftest.py puts the long ones first.
parallel="-q -n auto --dist loadfile --no-loadscope-reorder -p scripts.slowest_tests"
# Tracing every line makes a test take three times as long: only what the gates below ask for is measured. Lines of a kernel
# are reached where it is interpreted only, so its compiled tests are not traced.
measured="tests/planner tests/optimizers tests/sensing tests/mission_io"
rm -f .coverage .coverage.* .test_times.jsonl
export TEST_TIMES="$PWD/.test_times.jsonl"
# These only compute: they take what the flights, which have a clock and wait for each other, leave of the cores.
compute() {
    failures=0
    trap 'kill "$running" 2>/dev/null || true; exit 1' TERM
    env COVERAGE_FILE=.coverage.compiled nice -n 19 \
        "$bin/python" -m pytest $parallel --cov --cov-report= $measured > "$scratch/compiled" 2>&1 &
    running="$!"
    wait "$running" || failures=1
    env COVERAGE_FILE=.coverage.interpreted NUMBA_DISABLE_JIT=1 nice -n 19 \
        "$bin/python" -m pytest $parallel --cov --cov-report= tests/kernels > "$scratch/interpreted" 2>&1 &
    running="$!"
    wait "$running" || failures=1
    return "$failures"
}
compute &
background="$!"
failed=""
echo "gate: tests of commands, whole flights, compiled kernels, set-up, and all the rest"
"$bin/python" -m pytest $parallel $(printf -- '--ignore=%s ' $measured) || failed="$failed the-rest"
echo "gate: tests of mission_io and of the planner's core; tests of the kernels, JIT off, so that their coverage can be measured"
wait "$background" || failed="$failed mission_io-planner-or-kernels-without-JIT"
cat "$scratch/compiled" "$scratch/interpreted"
"$bin/python" scripts/slowest_tests.py .test_times.jsonl
[ -z "$failed" ] || { echo "tests failed:$failed" >&2; exit 1; }
echo "gate: branch coverage: 95 % of mission_io, 90 % of the planner's core"
"$bin/coverage" combine -q .coverage.compiled .coverage.interpreted
"$bin/coverage" report --include='mission_io/*' --fail-under=95
# The workflows beside the planner's core are tested by commands, which are not traced.
workflows="command.py,plan_*.py,close_gaps.py,select.py,pareto_file.py"
"$bin/coverage" report --include='uavcover/planner/*,uavcover/optimizers/*,uavcover/sensing/*,uavcover/kernels/*' \
    --omit="uavcover/planner/$(echo "$workflows" | sed 's|,|,uavcover/planner/|g')" --fail-under=90
