"""The table of ``scripts/fly_faults.py``: one row for each flight with random faults, as .csv and as a page."""

import csv
import datetime
import os
import platform
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from importlib import metadata
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Row:
    """One flight of the table.

    Attributes:
        flight: its number.
        autopilot: whose behaviour.
        happens: faults, stops and pauses.
        loss: of the link.
        ending: its name.
        waypoints: how many were passed, of how many.
        incidents: what was told as going wrong, in order.
        arrived: positions that reached this side while it was recorded, counted by pymavlink.
        recorded: rows of its track.
        resumed: the endings of the flights that went on with it; empty when nothing was left.
    """

    flight: int
    autopilot: str
    happens: str
    loss: float
    ending: str
    waypoints: str
    incidents: str
    arrived: int
    recorded: int
    resumed: str

    @property
    def good(self) -> bool:
        """Whether it is as it should be."""
        finished = self.resumed.split()[-1:] in (["landed"], [])
        return "unnamed" not in self.ending + self.resumed and int(self.arrived) == int(self.recorded) and finished


def kept_rows(out: Path | None) -> list[Row]:
    """The rows that are there already."""
    path = None if out is None else out.with_suffix(".csv")
    if path is None or not path.exists():
        return []
    with path.open(newline="") as file:
        return [
            Row(
                **{
                    **row,
                    **{name: int(row[name]) for name in ("flight", "arrived", "recorded")},
                    "loss": float(row["loss"]),
                }
            )
            for row in csv.DictReader(file)
        ]


def write_csv(out: Path, rows: Sequence[Row]) -> None:
    """The rows, beside the page."""
    with out.with_suffix(".csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([[field.name for field in fields(Row)], *(astuple(row) for row in rows)])


def summary(rows: Sequence[Row], left_open: str) -> str:
    """The result in words."""
    endings = Counter(row.ending for row in rows)
    lost = sum(row.arrived - row.recorded for row in rows)
    finished = sum(row.resumed.split()[-1] == "landed" for row in rows if row.resumed)
    return (
        f"{len(rows)} flights, {sum('unnamed' in row.ending for row in rows)} without a named ending: "
        + ", ".join(f"{name} {count}" for name, count in endings.most_common())
        + f". Of {sum(row.arrived for row in rows)} positions that arrived while flights were recorded, {lost} are missing in "
        f"the tracks. {finished} of {sum(bool(row.resumed) for row in rows)} flights that had something left were finished by "
        f"going on with them. {left_open}"
    )


def write_page(out: Path, rows: Sequence[Row], words: str, *, flights: int, seed: int) -> None:
    """The Markdown page."""
    lines = [
        "# Flights with random faults, measured",
        "",
        f"Command: `.venv/bin/python scripts/fly_faults.py --flights {flights} --seed {seed}`, "
        f"{datetime.date.today().isoformat()}, uavcover {metadata.version('uavcover')}, Python "
        f"{platform.python_version()}, {os.cpu_count()} cores ({platform.machine()}). What is done is said at the top of the "
        "script; what the faults are, in `uavcover mock-vehicle --help`.",
        "",
        words,
        "",
        "| flight | autopilot | what happens | loss | ending | waypoints | told as going wrong | arrived | recorded | "
        "gone on with |",
        "|---:|---|---|---:|---|---|---|---:|---:|---|",
    ]
    lines += [
        f"| {r.flight} | {r.autopilot} | {r.happens} | {100 * r.loss:g} % | {r.ending} | {r.waypoints} | {r.incidents or '-'} | "
        f"{r.arrived} | {r.recorded} | {r.resumed or '-'} |"
        for r in rows
    ]
    out.write_text("\n".join(lines) + "\n")
