"""Finding and closing the gaps of a run, as ``gaps`` does it."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.cli.console import Console, percent
from uavcover.cli.verifying import judge_run, say_inputs
from uavcover.model.verdict import VerificationReport
from uavcover.run import judge
from uavcover.run.folder import RunFolder
from uavcover.run.judged_inputs import check_accepted, logs_of_the_verdict
from uavcover.run.resume import flown_tracks

GAP_FILES = ("gaps.geojson", "gap_mission.waypoints")


class Start(StrEnum):
    """Where a gap mission begins."""

    HOME = "home"
    LAST = "last"


def close_gaps(
    run: RunFolder,
    console: Console,
    *,
    logs: Sequence[Path],
    target: float | None,
    min_area_m2: float,
    start: Start,
    force: bool,
    command: Sequence[str],
    accepted: Sequence[str] = (),
) -> dict[str, Any]:
    """Write the gaps of a run and the mission that closes them, and say what it takes; returns the answer for ``--json``.

    Without logs it takes what the verdict in the folder took.
    """
    judge.check_gap_request(min_area_m2=min_area_m2, target=target)
    check_accepted(accepted)
    run.existing("scenario.toml", made_by="uavcover plan")
    judged = list(logs) or logs_of_the_verdict(run)
    run.remove(GAP_FILES)
    site, verdict, sources, inputs = judge_run(run, console, logs=judged, accepted=accepted)
    report = verdict.report
    say_inputs(console, inputs)
    _say_gaps(console, report)
    document: dict[str, Any] = {
        "run": str(run),
        "tracks": sources,
        "inputs": inputs.hashes,
        "accepted_changes": [asdict(change) for change in inputs.changes],
        "gaps": len(report.gaps),
        "coverage_of_coverable": report.coverage_of_coverable,
        "verdict": report.verdict,
        "mission": None,
        "target_met": True,
    }
    judge.save_gaps(run, verdict, command=command)
    wanted = [gap for gap in report.gaps if gap.coverable and gap.area_m2 >= min_area_m2]
    if not wanted or (target is not None and report.coverage_of_coverable >= target):
        console.say(f"nothing to close; written: {run.file('gaps.geojson')}")
        return document
    with console.progress("planning the gap mission"):
        own_logs = list(logs) or flown_tracks(run)
        in_the_air = judge.read_log(own_logs[-1], site).track if start is Start.LAST else None
        mission = judge.plan_gap_mission(site, verdict, min_area_m2=min_area_m2, target=target, in_the_air=in_the_air)
    folder = judge.save_gap_mission(run, site, mission, command=command, force=force)
    path = mission.wanted.path_m
    length_m = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    document |= {
        "mission": str(run.file("gap_mission.waypoints")),
        "folder": str(folder),
        "start": start.value,
        "waypoint_count": len(mission.closing.route),
        "path_length_m": length_m,
        "flight_time_s": mission.wanted.flight_time_s,
        "coverage_after": mission.coverage_after,
        "target_met": mission.plan.rule_met,
    }
    console.say(
        f"gap mission       {len(mission.closing.route)} waypoints, {length_m:.0f} m and "
        f"{mission.wanted.flight_time_s:.0f} s with the ways there and home; after it {percent(mission.coverage_after)} of "
        "what can be seen"
    )
    if mission.closing.seen_m2 < mission.closing.wanted_m2 and target is None:
        left_m2 = mission.closing.wanted_m2 - mission.closing.seen_m2
        console.warn(f"{left_m2:.0f} square metres of the gaps stay open: no leg inside the limits was found for them")
    if not mission.plan.rule_met and target is not None:
        console.warn(f"the mission does not reach {percent(target)}; the best there is has been written")
    console.say(f"written: {run.file('gaps.geojson')}, {run.file('gap_mission.waypoints')}. Next:")
    if start is Start.LAST:
        console.say(f"  uavcover fly {folder} --resume --to URL, from wherever the vehicle holds in the air;")
        console.say(
            f"  or from a ground station: uavcover upload {run.file('gap_mission.waypoints')} --to URL --in-flight,"
        )
        console.say("  started at its first item; it does not take off, and begins where the last log ends;")
        console.say("  or from home, if the vehicle has landed:")
    console.say(f"  uavcover plan-upload {folder} --to URL; uavcover fly {folder} --to URL")
    own = " ".join(f"--log {path}" for path in (*own_logs, folder.file("track.csv")))
    console.say(f"  uavcover verify {run} {own}")
    return document


def _say_gaps(console: Console, report: VerificationReport) -> None:
    areas: dict[str, float] = defaultdict(float)
    for gap in report.gaps:
        areas[gap.reason] += gap.area_m2
    console.say(
        f"coverage flown    {percent(report.coverage_fraction)} of the area, "
        f"{percent(report.coverage_of_coverable)} of what can be seen"
    )
    if not report.passed:
        console.say(f"verdict           {report.verdict.upper()} (uavcover verify says why)")
    console.say(f"gaps              {len(report.gaps)}, {sum(areas.values()):.0f} square metres in all")
    for name, area_m2 in sorted(areas.items(), key=lambda item: -item[1]):
        console.say(f"                  {name}: {area_m2:.0f} square metres")
