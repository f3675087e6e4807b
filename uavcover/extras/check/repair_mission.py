"""The workflow of ``uavcover check --fix``: plain repairs of somebody's mission, into another file."""

import dataclasses
from pathlib import Path

from mission_io.formats import files, plan
from mission_io.formats.text import text_from_bytes
from mission_io.model.items import GeoPoint, Mission
from uavcover.errors import InputError, OutputError
from uavcover.extras.check.check import Checked
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.mission_file import CheckQuery, aircraft_of, read_mission_file
from uavcover.extras.check.repair import repaired
from uavcover.extras.check.split import parts_of
from uavcover.run.file_group import numbered, write_file
from uavcover.run.user import User


def refuse_repair_into(file: Path, out: Path | None, *, force: bool) -> Path:
    """Where repairs are written to.

    Raises:
        InputError: there is no name, or one of another format.
        OutputError: it is the mission itself, or there already.
    """
    wanted = ".plan" if file.suffix.lower() == ".plan" else ".waypoints"
    if out is None:
        raise InputError(
            f"--fix: name another file for the repaired mission with -o, such as {file.stem}-fixed{wanted}"
        )
    if out.suffix.lower() != wanted:
        raise InputError(f"-o: {out}: repairs of a {file.suffix} file are written as {wanted}; name it so")
    if out.exists() and out.samefile(file):
        raise OutputError(f"-o: {out} is the mission itself; give another name")
    if out.exists() and not force:
        raise OutputError(f"{out}: is there already; give another name, or --force to replace it")
    return out


def repair_mission(
    query: CheckQuery, checked: Checked, out: Path, user: User, *, force: bool = False
) -> tuple[Path, ...]:
    """Write the mission with plain repairs, and tell what was changed; no file where there is nothing to repair.

    With more items than ``query.most_items`` it is written in parts, ``OUT-1`` and so on.

    Raises:
        InputError: places are wrong, which nobody but the user can repair, or it is to be split and is not plain.
        OutputError: a file cannot be written.
        FormatError: the format cannot hold the mission.
    """
    wrong = next((one for one in checked.findings if one.kind == "place" and one.weight == "breaks"), None)
    if wrong is not None or checked.world is None:
        what = "its places are wrong" if wrong is None else wrong.what
        raise InputError(f"--fix: {query.file}: {what}; correct that first")
    world = checked.world
    read = read_mission_file(query.file)
    aircraft = aircraft_of(query, read)
    fixed = repaired(read.mission, world, query.limits, lambda mission: flown_path(mission, world, aircraft))
    mission = fixed.mission
    most = query.most_items
    is_long = most is not None and len(mission.items) > most
    if not fixed.raised and not fixed.inserted and not is_long:
        user.say("nothing that plain repairs would change; no file was written")
        return ()
    if mission.home is None:
        mission = dataclasses.replace(mission, home=GeoPoint(*world.geodetic([0.0, 0.0, 0.0])))
    parts: tuple[Mission, ...] = (mission,)
    names = [out]
    if is_long and most is not None:
        parts = parts_of(mission, world, query.limits, aircraft, most_items=most)
        names = [out.with_name(numbered(out, number)) for number in range(1, len(parts) + 1)]
        there = next((name for name in names if name.exists()), None)
        if there is not None and not force:
            raise OutputError(f"{there}: is there already; give another name, or --force to replace it")
    for name, part in zip(names, parts, strict=True):
        _write(query.file, name, part)
    changes = f"{_numbers(fixed.raised)} raised, {_numbers(fixed.inserted)} put in"
    split = f"; {len(parts)} flights of {max(len(part.items) for part in parts)} items at most" if is_long else ""
    user.say(f"written: {', '.join(map(str, names))}: {changes}{split}")
    return tuple(names)


def _write(file: Path, out: Path, mission: Mission) -> None:
    if file.suffix.lower() == ".plan":
        document = plan.read_to_keep(text_from_bytes(file.read_bytes()).text)
        write_file(out, plan.write(document.with_mission(mission)).encode())
    else:
        files.write_mission(mission, out)


def _numbers(numbers: tuple[int, ...]) -> str:
    if not numbers:
        return "no item"
    return f"{'item' if len(numbers) == 1 else 'items'} {', '.join(map(str, numbers))}"
