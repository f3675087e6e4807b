"""QGroundControl's JSON files from before ``.plan``: ``.mission`` of versions 1 and 2, ``.fence`` and ``.rally``.

A ``.mission`` of version 1 has an item's parameters as ``param1`` to ``param4`` and a ``coordinate``, and home as such an
item; one of version 2 is what a ``.plan`` has as its part ``mission``. They are read, and written as ``.plan``.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mission_io.errors import FormatError
from mission_io.formats.json_node import Node, parse_json
from mission_io.formats.plan import read_home, read_items
from mission_io.formats.plan_areas import read_fence_part, read_rally_part
from mission_io.formats.plan_items import read_simple
from mission_io.formats.text import clean_text
from mission_io.model.areas import Fence, RallyPoints
from mission_io.model.items import Command, GeoPoint, Mission, MissionItem

_VERSIONS_1 = (1, "1", "1.0")


@dataclass(frozen=True, slots=True)
class OldFile:
    """The one list that such a file holds, and what was repaired to read it, one line each.

    Attributes:
        mission: Of a ``.mission``.
        fence: Of a ``.fence``.
        rally: Of a ``.rally``.
        repairs: One line each.
    """

    mission: Mission | None = None
    fence: Fence | None = None
    rally: RallyPoints | None = None
    repairs: tuple[str, ...] = ()


def read(text: str) -> OldFile:
    """Read a file of any of the three kinds, which its header names.

    Raises:
        FormatError: with the place in the document; also for surveys, whose items these files do not contain.
    """
    clean = clean_text(text)
    root = parse_json(clean.text, "file")
    repairs = [*clean.repairs, "a QGroundControl file older than .plan"]
    kind = root.optional("fileType", lambda node: node.value, None)
    if kind == "GeoFence":
        return OldFile(fence=read_fence_part(root, repairs), repairs=tuple(repairs))
    if kind == "RallyPoints":
        return OldFile(rally=read_rally_part(root), repairs=tuple(repairs))
    if kind not in (None, "Mission") or "items" not in root.value:
        raise FormatError("the JSON is not a mission", where="file", advice="choose a .plan or .mission file")
    version = root.optional("version", lambda node: node.value, 1)
    if version in _VERSIONS_1 and version is not True:
        return OldFile(_mission_of_version_1(root, repairs), repairs=tuple(repairs))
    if version != 2:
        raise FormatError(f"version {version!r:.20} is not known", where="file.version", advice="it must be 1 or 2")
    extras: dict[str, Mapping[str, Any]] = {}
    home = read_home(root.get("plannedHomePosition"), repairs, extras)
    items, entries = read_items(root.get("items"), repairs)
    _refuse_surveys(not all(entry.is_flyable for entry in entries))
    return OldFile(Mission(home, items), repairs=tuple(repairs))


def _mission_of_version_1(root: Node, repairs: list[str]) -> Mission:
    nothing: list[Node] = []
    _refuse_surveys(bool(root.optional("complexItems", Node.nodes, nothing)))
    items: list[MissionItem] = []
    numbers: dict[int, int] = {}
    for number, node in enumerate(root.get("items").nodes(), start=1):
        items.append(_item(node))
        numbers.setdefault(node.optional("id", Node.whole, number), number)
    home: GeoPoint | None = None
    if "plannedHomePosition" in root.value:
        home = _home(root.get("plannedHomePosition"), repairs)
    return Mission(home, tuple(_jump_to(item, numbers) for item in items))


def _home(node: Node, repairs: list[str]) -> GeoPoint | None:
    extras: dict[str, Mapping[str, Any]] = {}
    place = node.get("coordinate") if isinstance(node.value, Mapping) else node
    return read_home(place, repairs, extras)


def _item(node: Node) -> MissionItem:
    """An item of version 1, put into the form of version 2."""
    names = ("param1", "param2", "param3", "param4")
    params = [node.get(name).value for name in names] + [one.value for one in node.get("coordinate").nodes()]
    return read_simple(Node({**node.value, "params": params}, node.where))


def _jump_to(item: MissionItem, numbers: Mapping[int, int]) -> MissionItem:
    """A jump goes to the ``id`` of an item, which need not be its number."""
    if item.command != Command.DO_JUMP:
        return item
    target, p2, p3, p4 = item.params
    if target not in numbers:
        what = f"a jump to {target:g}, but no item has this id"
        raise FormatError(what, where="file.items", advice="change the jump")
    return dataclasses.replace(item, params=(float(numbers[int(target)]), p2, p3, p4))


def _refuse_surveys(there_are_some: bool) -> None:
    if there_are_some:
        what = "the items of the survey are not in the file"
        raise FormatError(what, where="file", advice="upload it with QGroundControl and download the mission")
