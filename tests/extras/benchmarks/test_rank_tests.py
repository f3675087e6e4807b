"""Rank tests against hand-made cases, and scipy where it has them."""

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from uavcover.extras.benchmarks.rank_tests import compared, friedman, holm, rank_sum_p


class TestRankSum:
    def test_exact_p_of_ten_runs_that_are_all_better_counts_both_extreme_orders(self) -> None:
        low, high = np.arange(10.0), np.arange(10.0, 20.0)
        orders = sum(1 for _ in combinations(range(20), 10))
        assert rank_sum_p(low, high) == pytest.approx(2 / orders)

    def test_every_order_of_small_samples_counted_by_hand(self) -> None:
        one, other = np.array([1.0, 4.0]), np.array([2.0, 3.0, 5.0])
        pool = np.concatenate([one, other])
        ranks = stats.rankdata(pool)
        own = ranks[:2].sum()
        sums = [sum(ranks[list(chosen)]) for chosen in combinations(range(5), 2)]
        middle = 2 * 6 / 2
        extreme = sum(abs(total - middle) >= abs(own - middle) for total in sums)
        assert rank_sum_p(one, other) == pytest.approx(extreme / len(sums))

    def test_equal_samples_are_no_evidence(self) -> None:
        assert rank_sum_p([0.0, 0.0], [0.0, 0.0]) == 1.0


class TestHolm:
    def test_example_of_four(self) -> None:
        # 0.005 * 4, 0.01 * 3, then 0.03 * 2 and never less than before
        assert holm([0.01, 0.04, 0.03, 0.005]).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])

    def test_never_above_one(self) -> None:
        assert holm([0.6, 0.9]).tolist() == [1.0, 1.0]

    def test_one_test_is_not_corrected(self) -> None:
        assert holm([0.03]).tolist() == [0.03]


class TestCompared:
    def test_less_is_better(self) -> None:
        low, high = np.arange(10.0), np.arange(10.0, 20.0)
        rivals = [("worse", high), ("same", low + 0.01), ("better", low - 20.0)]
        assert [one.outcome for one in compared(low, rivals, better="less")] == ["win", "tie", "loss"]
        assert [one.outcome for one in compared(low, rivals, better="more")] == ["loss", "tie", "win"]

    def test_more_rivals_make_it_harder(self) -> None:
        mine, rival = np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0, 8.0])  # p = 2/70
        alone = compared(mine, [("a", rival)], better="less")
        beside_others = compared(mine, [("a", rival), ("b", rival), ("c", rival)], better="less")
        assert alone[0].outcome == "win"
        assert {one.outcome for one in beside_others} == {"tie"}
        assert beside_others[0].p_holm == pytest.approx(3 * alone[0].p)


class TestFriedman:
    def test_as_scipy(self) -> None:
        values = np.random.default_rng(1).random((8, 4))
        assert friedman(values, better="less").p == pytest.approx(stats.friedmanchisquare(*values.T).pvalue)

    def test_more_is_better_turns_the_ranks(self) -> None:
        values = [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]
        assert friedman(values, better="more").ranks.tolist() == [3.0, 2.0, 1.0]

    def test_two_contenders_have_ranks_but_no_test(self) -> None:
        reported = friedman([[1.0, 2.0]], better="less")
        assert reported.ranks.tolist() == [1.0, 2.0]
        assert np.isnan(reported.p)
