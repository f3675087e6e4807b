import dataclasses

import numpy as np
import pytest

from uavcover.errors import InputError
from uavcover.model.route import MissionSize, Route, RouteMember, RouteMetrics
from uavcover.planner.selection_rule import (
    Choice,
    Condition,
    missing_index,
    parse_rule,
    select,
    select_flown,
    without_overfitted,
)


def member(coverage: float, waypoints: int, length_m: float, origin: str = "test") -> RouteMember:
    # The share of the whole area is misleading on purpose: every rule speaks of what is coverable.
    metrics = RouteMetrics(1.0 - coverage, coverage, waypoints, length_m, 1.0, 1.0, 1.0, length_m)
    return RouteMember(Route(np.zeros((1, 3))), metrics, 0.0, origin)


MEMBERS = [member(0.5, 10, 100.0), member(0.8, 20, 150.0), member(0.9, 12, 220.0), member(1.0, 30, 300.0)]


@pytest.mark.parametrize(
    ("rule", "index"),
    [
        # Scaled to 0..1: costs of coverage 1, .4, .2, 0; waypoints 0, .5, .1, 1; length 0, .25, .6, 1.
        ("weighted", 2),  # 0.6/0.2/0.2: 0.6, 0.39, 0.26, 0.4
        ("weighted:1,0,0", 3),
        ("weighted:0,1,0", 0),
        ("weighted:0,1,1", 0),
        ("weighted:3,0,4", 1),  # 3, 2.2, 3.0, 4
        ("weighted: 3, 0, 4", 1),
        ("knee", 2),  # squares: 1, 0.4725, 0.41, 2
        ("max-coverage", 3),
        ("coverage>=0.8", 1),
        (" coverage >= 0.81 ", 2),
        ("coverage>=0", 0),
        ("coverage>=1", 3),
        ("index:1", 1),
    ],
)
def test_each_rule(rule: str, index: int) -> None:
    assert select(MEMBERS, parse_rule(rule)) == Choice(index, met=True)


def test_coverage_out_of_reach_takes_the_best_and_says_so() -> None:
    assert select(MEMBERS[:3], parse_rule("coverage>=0.95")) == Choice(2, met=False)


def test_ties() -> None:
    twins = [member(0.9, 5, 100.0), member(0.9, 4, 100.0), member(0.9, 4, 100.0)]
    assert select(twins, parse_rule("max-coverage")).index == 0
    assert select(twins, parse_rule("coverage>=0.5")).index == 0
    assert select(twins, parse_rule("knee")).index == 1
    assert select(twins, parse_rule("weighted")).index == 1
    # Equal length: the one that sees more.
    assert select([member(0.9, 4, 100.0), member(0.95, 5, 100.0)], parse_rule("coverage>=0.8")).index == 1
    # Equal coverage: the shorter one, reached or not.
    longer_first = [member(0.9, 4, 120.0), member(0.9, 5, 100.0)]
    assert select(longer_first, parse_rule("max-coverage")).index == 1
    assert select(longer_first, parse_rule("coverage>=0.99")) == Choice(1, met=False)


def test_parts_of_routes_make_no_knee() -> None:
    parts = [member(0.1, 2, 20.0, "part of test"), member(0.6, 6, 110.0, "part of test")]
    for rule in ("knee", "weighted"):
        assert select([*parts, *MEMBERS], parse_rule(rule)) == Choice(2 + 2, met=True)
        assert select(parts, parse_rule(rule)).met
    assert select([*parts, *MEMBERS], parse_rule("coverage>=0.55")).index == 1


def test_a_set_of_one() -> None:
    for rule in ("weighted", "knee", "max-coverage", "coverage>=0.1", "index:0"):
        assert select(MEMBERS[:1], parse_rule(rule)) == Choice(0, met=True)


@pytest.mark.parametrize(
    "text",
    [
        "weighted:1,2", "weighted:1,2,3,4", "weighted:a,b,c", "weighted:-1,1,1", "weighted:0,0,0", "weighted:nan,1,1",
        "weighted:inf,1,1", "weighted:1,,1",
    ],
)  # fmt: skip
def test_weights_that_make_no_sense(text: str) -> None:
    with pytest.raises(InputError, match="requires three weights"):
        parse_rule(text)


@pytest.mark.parametrize("text", ["coverage>=1.5", "coverage>=-0.1", "coverage>=1e", "coverage>=1e9"])
def test_shares_that_make_no_sense(text: str) -> None:
    with pytest.raises(InputError, match="requires a fraction between 0 and 1"):
        parse_rule(text)


@pytest.mark.parametrize(
    "text", ["", "best", "weighted:", "coverage>0.9", "coverage>=", "index:-1", "index:1.5", "KNEE"]
)
def test_words_that_are_no_rule(text: str) -> None:
    with pytest.raises(InputError, match=r"unknown rule .*; use weighted"):
        parse_rule(text)


def test_an_index_outside_the_set_and_an_empty_set() -> None:
    """A plan is not lost for it: it writes the route with the most coverage."""
    choice = select(MEMBERS, parse_rule("index:4"))
    assert (choice.index, choice.met) == (select(MEMBERS, parse_rule("max-coverage")).index, False)
    assert missing_index(parse_rule("index:3"), len(MEMBERS)) is None
    assert (
        missing_index(parse_rule("index:4"), len(MEMBERS)) == "index:4 does not exist; the set has the members 0 to 3"
    )
    with pytest.raises(InputError, match="empty"):
        select([], parse_rule("knee"))


def test_only_one_rule_asks_for_a_coverage() -> None:
    assert parse_rule("coverage>=0.95").required_coverage == 0.95
    assert parse_rule("knee").required_coverage is None


def _elsewhere(members, truths):
    """What other cells see, by the route itself."""
    by_route = {id(m.route): truth for m, truth in zip(members, truths, strict=True)}
    return lambda route: by_route[id(route)]


def test_a_route_that_its_cells_flatter_is_not_chosen():
    # Cheapest first; the first two reach 0.98 on their own cells alone.
    members = [member(0.9802, 5, 100.0), member(0.9805, 5, 101.0), member(0.9803, 5, 105.0), member(0.99, 5, 120.0)]
    truths = [0.976, 0.9793, 0.9801, 0.9899]
    rule = parse_rule("coverage>=0.98")
    left = without_overfitted(members, rule, _elsewhere(members, truths), cells=10_000)
    assert left == members[2:]
    assert left[select(left, rule).index] is members[2]


def test_what_the_rule_would_not_choose_is_not_looked_at():
    members = [member(0.9801, 5, 100.0), member(0.99, 5, 120.0), member(0.95, 5, 80.0)]
    evaluated = []
    left = without_overfitted(
        members, parse_rule("coverage>=0.98"), lambda route: evaluated.append(route) or 0.9801, cells=10_000
    )
    assert left == members
    assert evaluated == [members[0].route]


def test_when_none_is_confirmed_the_one_that_lacks_least_stays():
    members = [member(0.9802, 5, 100.0), member(0.9803, 5, 101.0), member(0.97, 5, 90.0)]
    rule = parse_rule("coverage>=0.98")
    left = without_overfitted(members, rule, _elsewhere(members, [0.97, 0.975, 0.97]), cells=10_000)
    assert left == members[1:]
    choice = select(left, rule)
    assert (left[choice.index], choice.met) == (members[1], True)


@pytest.mark.parametrize("text", ["max-coverage", "knee", "weighted", "coverage>=0.999"])
def test_the_other_rules_do_not_fall_for_luck_either(text):
    members = [member(0.9, 4, 90.0), member(0.95, 4, 95.0), member(0.97, 4, 96.0)]
    rule = parse_rule(text)
    overfitted = members[select(members, rule).index]
    truths = [m.metrics.coverage_of_coverable - (0.02 if m is overfitted else 0.0) for m in members]
    assert overfitted not in without_overfitted(members, rule, _elsewhere(members, truths), cells=10_000)
    assert without_overfitted(members, parse_rule("index:2"), lambda _: 0.0, cells=10_000) == members


def test_of_few_cells_two_say_nothing():
    members = [member(0.98, 5, 100.0), member(0.99, 5, 120.0)]
    rule = parse_rule("coverage>=0.98")
    assert without_overfitted(members, rule, lambda _: 0.965, cells=100) == members
    assert without_overfitted(members, rule, lambda _: 0.965, cells=1000) != members


def flown(member: RouteMember, sorties: int, vehicles: int, makespan_s: float) -> RouteMember:
    return dataclasses.replace(member, mission=MissionSize(sorties=sorties, vehicles=vehicles, makespan_s=makespan_s))


FLOWN = [
    flown(MEMBERS[0], 1, 1, 600.0),
    flown(MEMBERS[1], 2, 2, 500.0),
    flown(MEMBERS[2], 3, 2, 900.0),
    flown(MEMBERS[3], 4, 3, 800.0),
]


@pytest.mark.parametrize(
    ("rule", "index", "met"),
    [
        ("max-coverage,sorties<=3", 2, True),
        ("sorties<=2", 1, True),
        ("done<=10m", 1, True),
        ("done<=800s", 3, True),
        ("coverage>=0.8,done<=0.25h", 1, True),
        ("coverage>=0.8, vehicles <= 1", 0, False),  # what keeps the conditions, and then the most coverage
        ("coverage>=0.95,sorties<=3,done<=15m", 2, False),
        ("done<=100s", 1, False),  # none does: the one that is nearest
        ("weighted:1,0,0,vehicles<=2", 2, True),
        ("knee,sorties<=1", 0, True),
    ],
)
def test_conditions_on_how_a_route_is_flown(rule: str, index: int, met: bool) -> None:
    assert select_flown(FLOWN, parse_rule(rule), soonest=False) == Choice(index, met=met)


def test_what_cannot_be_flown_keeps_no_condition() -> None:
    members = [MEMBERS[3], FLOWN[0]]
    assert select_flown(members, parse_rule("max-coverage,sorties<=9"), soonest=False) == Choice(1, met=True)
    assert select_flown(members[:1], parse_rule("sorties<=9"), soonest=False) == Choice(0, met=False)
    assert select_flown(members, parse_rule("coverage>=0.4"), soonest=True) == Choice(1, met=True)


def test_several_vehicles_take_what_they_are_done_with_soonest() -> None:
    assert select_flown(FLOWN, parse_rule("coverage>=0.85"), soonest=True) == Choice(3, met=True)
    assert select_flown(FLOWN, parse_rule("coverage>=0.85"), soonest=False) == Choice(2, met=True)


def test_conditions_are_read_from_the_end() -> None:
    rule = parse_rule(" weighted:3,0,4 , sorties<=2,done <= 1.5h ")
    assert (rule.kind, rule.numbers) == ("weighted", (3.0, 0.0, 4.0))
    assert rule.conditions == (Condition("sorties", 2.0), Condition("done", 5400.0))
    assert parse_rule(rule.text) == rule
    assert parse_rule("coverage>=0.9,sorties<=2").required_coverage == 0.9


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("index:3,sorties<=1", "selects a single route"),
        ("coverage>=0.9,speed<=3", "unknown condition 'speed'; use sorties<=N"),
        ("done<=soon", "done<= requires a time such as 40m"),
        ("done<=0m", "done<= requires a time"),
        ("done<=nan", "done<= requires a time"),
        ("sorties<=0", "sorties<= requires a whole number of at least 1"),
        ("sorties<=1.5", "sorties<= requires a whole number of at least 1"),
        ("vehicles<=", "vehicles<= requires a whole number"),
        ("sorties<=2,sorties<=3", "two conditions of the same kind"),
        ("nearest,sorties<=2", "unknown rule"),
        ("coverage>=0.9,", "unknown rule"),
    ],
)
def test_conditions_that_make_no_sense(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse_rule(text)
