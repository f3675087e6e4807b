"""``uavcover bench``: the benchmarks of this project, each a command of its own."""

from collections.abc import Callable

import typer

from uavcover.cli.bench_coverage import bench_coverage
from uavcover.cli.bench_link import bench_link
from uavcover.cli.bench_mmf import bench_mmf
from uavcover.cli.bench_paper import bench_paper
from uavcover.cli.ending import ending_well
from uavcover.cli.options import Overview, one_by_one

bench = typer.Typer(
    cls=Overview,
    help="Measure what is claimed. Every benchmark can be stopped at any time; the same command goes on.",
    rich_markup_mode=None,
)

_BENCHMARKS: dict[str, tuple[Callable[..., int], str]] = {
    "coverage": (bench_coverage, "planners and baselines on the bundled scenarios, at equal time"),
    "link": (bench_link, "missions over links that lose datagrams, against MAVSDK"),
    "mmf": (bench_mmf, "the paper's 24 functions: Tables 3 and 4, tests, figures"),
    "paper": (bench_paper, "the paper's simulation: Tables 5 and 6, Figures 7 to 11"),
}

for _name, (_command, _short) in _BENCHMARKS.items():
    bench.command(_name, short_help=_short, rich_help_panel="Measure")(ending_well(one_by_one(_command)))


@bench.callback()
def _group() -> None:
    """Keep ``mmf`` a command also while it is the only one."""
