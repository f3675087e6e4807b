"""``[[vehicle]]`` given several times: equal vehicles are one [vehicle] and their number, others are listed with their homes.

One vehicle with ``[[launch_point]]`` besides its [home] is listed like that too, once for each place, for one flight at a time.
"""

from typing import Any

from uavcover.errors import ScenarioError

LAUNCH_POINTS = "launch_point"

_OF_SEVERAL = {
    "home": "takes its home from [home]",
    "area": "covers the whole [area]",
    "sensor": "takes its sensor from [sensor]",
}
"""Keys of a [[vehicle]] that one vehicle alone does not have, and where it has them."""


def with_fleet(raw: dict[str, Any], *, source: str) -> dict[str, Any]:
    """Rewrite a scenario file's list of vehicles: as one [vehicle] and their number, or as one each where they differ.

    Args:
        raw: of the whole file; not changed.
        source: names the file in errors.

    Raises:
        ScenarioError: a vehicle has no home, [home] belongs to no vehicle, or their number is not that of [fleet].
    """
    if "vehicles" in raw:
        raise ScenarioError(f"{source}: vehicles: unknown key; write one [[vehicle]] table for each vehicle")
    raw = _with_launch_points(raw, source=source)
    listed, fleet, home = raw.get("vehicle"), raw.get("fleet", {}), raw.get("home")
    if isinstance(listed, dict):
        _refuse_of_several(listed, f"{source}: vehicle")
    if not isinstance(listed, list) or not listed or not all(isinstance(table, dict) for table in listed):
        return raw
    count = len(listed)
    if isinstance(fleet, dict):
        if fleet.get("vehicles", count) != count:
            raise ScenarioError(
                f"{source}: fleet.vehicles: the value is {fleet['vehicles']!r}, but there are {count} [[vehicle]] "
                "tables; use only one of the two"
            )
        fleet = {**fleet, "vehicles": count}
    first = listed[0]
    if not _OF_SEVERAL.keys() & first.keys() and all(table == first for table in listed[1:]):
        return raw | {"vehicle": first, "fleet": fleet}
    if count == 1:
        _refuse_of_several(first, f"{source}: vehicle.0")
    homes = [table.get("home", home) for table in listed]
    if missing := [number for number, place in enumerate(homes) if place is None]:
        raise ScenarioError(
            f"{source}: vehicle.{missing[0]}.home: the key is missing, and there is no [home] for vehicles without their own home"
        )
    if home is not None and home not in homes:
        raise ScenarioError(f"{source}: home: every [[vehicle]] has its own home; remove [home]")
    own = [{**table, "home": place} for table, place in zip(listed, homes, strict=True)]
    alike = {key: value for key, value in first.items() if key not in (*_OF_SEVERAL, "link", "system_id")}
    return raw | {"vehicle": alike, "vehicles": own, "home": homes[0], "fleet": fleet}


def _with_launch_points(raw: dict[str, Any], *, source: str) -> dict[str, Any]:
    """The tables with a [[vehicle]] for [home] and for each launch point."""
    if LAUNCH_POINTS not in raw:
        return raw
    points, vehicle, home, fleet = raw[LAUNCH_POINTS], raw.get("vehicle", {}), raw.get("home"), raw.get("fleet", {})
    if not isinstance(points, list) or not points or not all(isinstance(point, dict) for point in points):
        raise ScenarioError(
            f"{source}: {LAUNCH_POINTS}: write one [[{LAUNCH_POINTS}]] table with lat_deg and lon_deg for each position"
        )
    if home is None:
        raise ScenarioError(f"{source}: {LAUNCH_POINTS}: launch points require a [home]; write one of them as [home]")
    if not isinstance(vehicle, dict) or not isinstance(fleet, dict) or fleet.get("vehicles", 1) != 1:
        raise ScenarioError(
            f"{source}: {LAUNCH_POINTS}: launch points are supported for only one [vehicle]; define a home for each"
        )
    if fleet.get("one_at_a_time", True) is not True:
        raise ScenarioError(
            f"{source}: fleet.one_at_a_time: remove this key, because one vehicle with launch points "
            "always flies one sortie at a time"
        )
    _refuse_of_several(vehicle, f"{source}: vehicle")
    homes = [home, *points]
    for number, point in enumerate(homes):
        if point in homes[:number]:
            raise ScenarioError(f"{source}: {LAUNCH_POINTS}.{number - 1}: duplicates an earlier position; remove it")
    others = {key: value for key, value in raw.items() if key != LAUNCH_POINTS}
    return others | {
        "vehicle": [{**vehicle, "home": place} for place in homes],
        "fleet": {key: value for key, value in fleet.items() if key != "vehicles"} | {"one_at_a_time": True},
    }


def _refuse_of_several(table: dict[str, Any], where: str) -> None:
    for key, instead in _OF_SEVERAL.items():
        if key in table:
            raise ScenarioError(f"{where}.{key}: a single vehicle {instead}; use [[vehicle]] only for several vehicles")
