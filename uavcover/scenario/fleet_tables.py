"""``[[vehicle]]`` given several times: one [vehicle], and how many of it there are."""

from typing import Any

from uavcover.errors import ScenarioError


def with_fleet(raw: dict[str, Any], *, source: str) -> dict[str, Any]:
    """The tables of a scenario file with a list of equal vehicles as one [vehicle] and ``fleet.vehicles``.

    Args:
        raw: of the whole file; not changed.
        source: names the file in errors.

    Raises:
        ScenarioError: the vehicles differ, or their number is not that of [fleet].
    """
    listed = raw.get("vehicle")
    fleet = raw.get("fleet", {})
    if not isinstance(listed, list) or not listed or not all(isinstance(table, dict) for table in listed):
        return raw
    first = listed[0]
    for number, table in enumerate(listed[1:], start=1):
        for key in sorted({*first, *table}):
            if first.get(key) != table.get(key):
                raise ScenarioError(
                    f"{source}: vehicle.{number}.{key}: {_shown(table, key)} differs from vehicle.0's {_shown(first, key)}; the "
                    "vehicles of one plan must be equal (plan the others' part in a scenario of its own)"
                )
    if not isinstance(fleet, dict):
        return raw | {"vehicle": first}
    if fleet.get("vehicles", len(listed)) != len(listed):
        raise ScenarioError(
            f"{source}: fleet.vehicles: is {fleet['vehicles']!r}, and there are {len(listed)} [[vehicle]] tables; "
            "give one of both"
        )
    return raw | {"vehicle": first, "fleet": {**fleet, "vehicles": len(listed)}}


def _shown(table: dict[str, Any], key: str) -> str:
    return repr(table[key]) if key in table else "default"
