"""Is ours better than the other planners: rank-sum tests of the hypervolume, and Friedman's ranks over the scenarios."""

import statistics

import numpy as np

from uavcover.benchmarks.coverage.contenders import OURS, PLANNERS
from uavcover.benchmarks.coverage.summary import HIGH_COVERAGE, Outcomes, Sample
from uavcover.benchmarks.mmf_tables import markdown
from uavcover.benchmarks.rank_tests import compared, friedman

_FEWEST_RUNS = 2


def ranks_markdown(outcomes: Outcomes) -> str:
    """Both tables for every processor time that has enough runs of all; empty when none has."""
    parts = []
    for at_s in outcomes.times_s():
        for label, from_coverage in (("HV", 0.0), ("HV80", HIGH_COVERAGE)):
            told = _at(outcomes, at_s, label, from_coverage)
            if told:
                parts.append(told)
    return "\n".join(parts)


def _at(outcomes: Outcomes, at_s: float, label: str, from_coverage: float) -> str:
    lines, table = [], []
    for scenario in outcomes.scenarios:
        samples = {name: outcomes.at(scenario, name, at_s) for name in PLANNERS}
        values = {name: _volumes(found, from_coverage) for name, found in samples.items() if len(found) >= _FEWEST_RUNS}
        rivals = [(name, volumes) for name, volumes in values.items() if name != OURS]
        if OURS not in values or not rivals:
            continue
        told = {one.rival: one for one in compared(values[OURS], rivals, better="more")}
        cells = [f"{told[name].outcome} ({told[name].p_holm:.2g})" if name in told else "" for name in PLANNERS[1:]]
        lines.append([scenario, *cells])
        if len(values) == len(PLANNERS):
            table.append([statistics.mean(values[name].tolist()) for name in PLANNERS])
    if not lines:
        return ""
    text = [
        f"## {label} at {at_s:g} s: {OURS} against the others\n",
        "Rank-sum tests; p, adjusted by Holm within a scenario, in brackets; a tie when p is 0.05 or more.\n",
        markdown(["scenario", *PLANNERS[1:]], lines) + "\n",
    ]
    if table:
        ranks = friedman(table, better="more")
        text.append(
            f"Mean ranks over {len(table)} scenario(s), 1 is best: "
            + ", ".join(f"{name} {rank:.2f}" for name, rank in zip(PLANNERS, ranks.ranks, strict=True))
            + (f"; Friedman's p {ranks.p:.2g}" if np.isfinite(ranks.p) else "")
            + ".\n"
        )
    return "\n".join(text)


def _volumes(samples: list[Sample], from_coverage: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([sample.hypervolume(from_coverage=from_coverage) for sample in samples])
