"""What scripts/bench_cluster.py reads of a plan that was killed, and what it simulates."""

import pytest

from scripts.bench_cluster import makespan_s, read_rounds

TOLD = """planning square
INFO uavcover.run.cluster: look_at_block: 2 tasks, with 700 bytes for each worker
INFO uavcover.run.cluster: look_at_block: task of 10 bytes, answer of 20, 1.00 s of processor time
INFO uavcover.run.cluster: look_at_block: task of 10 bytes, answer of 20, 1.50 s of processor time
INFO uavcover.run.cluster: search: 3 tasks, with 700 bytes for each worker
INFO uavcover.run.cluster: search: task of 30 bytes, answer of 40, 5.00 s of processor time
planning square
INFO uavcover.run.cluster: look_at_block: 2 tasks, with 700 bytes for each worker
INFO uavcover.run.cluster: look_at_block: task of 10 bytes, answer of 20, 1.25 s of processor time
INFO uavcover.run.cluster: look_at_block: task of 10 bytes, answer of 20, 1.25 s of processor time
INFO uavcover.run.cluster: search: 2 tasks, with 700 bytes for each worker
INFO uavcover.run.cluster: search: task of 30 bytes, answer of 41, 6.00 s of processor time
INFO uavcover.run.cluster: search: task of 31 bytes, answer of 40, 7.00 s of processor time
INFO uavcover.run.cluster: search: 0 tasks, with 700 bytes for each worker
"""


def test_a_round_that_a_kill_divided_is_one_and_what_was_judged_again_counts_once() -> None:
    looked, searched, last = read_rounds(TOLD)
    assert [task.cpu_s for task in looked.tasks] == [1.25, 1.25]
    assert [task.cpu_s for task in searched.tasks] == [5.0, 6.0, 7.0]
    assert (searched.what, searched.shared, last.tasks) == ("search", 700, [])
    assert searched.tasks[1].answered == 41
    assert searched.tasks[2].sent == 31


def test_the_next_task_goes_to_who_is_free_first() -> None:
    assert makespan_s([3.0, 1.0, 1.0, 2.0], 2) == pytest.approx(4.0)
    assert makespan_s([3.0, 1.0, 1.0, 2.0], 1) == pytest.approx(7.0)
    assert makespan_s([3.0, 1.0], 64) == pytest.approx(3.0)
    assert makespan_s([], 4) == 0.0
