"""Every script does what it says, every row of every table is needed, and no reachable situation lacks one."""

from collections.abc import Callable
from typing import Any

import pytest

from mission_io.autopilots.autopilot import AUTOPILOTS
from mission_io.model.items import MissionType
from mission_io.protocol.download import DOWNLOAD_TABLE, Download
from mission_io.protocol.exchange import CLEAR_TABLE, Clear
from mission_io.protocol.server import MissionServer
from mission_io.protocol.tables import SERVER_TABLE, UPLOAD_TABLE, MissingRowError, Row, Table, UploadState
from mission_io.protocol.upload import Upload
from tests.mission_io.protocol import cases
from tests.mission_io.protocol.diagrams import mermaid
from tests.mission_io.protocol.scripts import GROUND, VEHICLE, Script, items, play

CLIENT = {"mission_type": MissionType.MISSION, "local": GROUND, "vehicle": VEHICLE, "now": 0.0}


def run_client(make: Callable[[Script], Any], script: Script) -> tuple[str, list[str]]:
    machine = make(script)
    sent = play(machine, script.steps, sender=VEHICLE, to=GROUND)
    return machine.state.name, sent


def run_server(script: Script) -> tuple[str, list[str]]:
    autopilot = next(a for a in AUTOPILOTS if a.name == script.autopilot)
    server = MissionServer(autopilot, local=VEHICLE, capacity=10)
    server.set_items(MissionType.MISSION, items(3))
    sent = play(server, script.steps, sender=GROUND, to=VEHICLE)
    return server.state.name, sent


MACHINES: dict[str, tuple[type, tuple[Script, ...], Callable[[Script], tuple[str, list[str]]]]] = {
    "upload": (Upload, cases.UPLOAD, lambda s: run_client(lambda c: Upload(items(c.items), **CLIENT), s)),
    "download": (Download, cases.DOWNLOAD, lambda s: run_client(lambda _: Download(**CLIENT), s)),
    "download in any order": (
        Download,
        (*cases.DOWNLOAD, *cases.DOWNLOAD_IN_ANY_ORDER),
        lambda s: run_client(lambda _: Download(**CLIENT, any_order=s in cases.DOWNLOAD_IN_ANY_ORDER), s),
    ),
    "clear": (Clear, cases.CLEAR, lambda s: run_client(lambda _: Clear(**CLIENT), s)),
    "server": (MissionServer, cases.SERVER, run_server),
}
ALL = [(name, script) for name, (_, scripts, _) in MACHINES.items() for script in scripts]


def expected(sends: str, sent: list[str]) -> bool:
    """Whether ``sent`` is what a script says."""
    if sends.startswith("..."):
        wanted = [part for part in sends.removeprefix("...").strip().split(", ") if part]
        return sent[len(sent) - len(wanted) :] == wanted
    if sends.endswith(" *"):
        return bool(sent) and set(sent) == {sends.removesuffix(" *")}
    return sent == [part.strip() for part in sends.split(",") if part.strip()]


@pytest.mark.parametrize(("machine", "script"), ALL, ids=[f"{n}: {s.shows} [{s.steps[:40]}]" for n, s in ALL])
def test_script(machine: str, script: Script) -> None:
    state, sent = MACHINES[machine][2](script)
    assert state == script.state
    assert expected(script.sends, sent), sent


class Recording(Table):  # type: ignore[type-arg]
    """A table that remembers which rows were looked up."""

    def __init__(self, rows: Any) -> None:
        super().__init__(rows)
        self.observed: set[Row] = set()  # type: ignore[type-arg]

    def row(self, state: Any, event: Any) -> Any:
        row = super().row(state, event)
        self.observed.add(row)
        return row


@pytest.mark.parametrize("machine", MACHINES)
def test_without_any_one_row_a_script_fails(machine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cls, scripts, run = MACHINES[machine]
    table = cls.table
    users: dict[Any, Script] = {}
    for script in scripts:
        recording = Recording(table.rows)
        monkeypatch.setattr(cls, "table", recording)
        run(script)
        for row in recording.observed:
            users.setdefault(row, script)
    unused = [f"{row.state.name} {row.event.name}" for row in table.rows if row not in users]
    assert not unused, "no script needs these rows"
    for row in table.rows:
        monkeypatch.setattr(cls, "table", Table(other for other in table.rows if other is not row))
        with pytest.raises(MissingRowError, match=row.event.name):
            run(users[row])


@pytest.mark.parametrize("table", [UPLOAD_TABLE, DOWNLOAD_TABLE, CLEAR_TABLE, SERVER_TABLE])
def test_no_two_rows_for_the_same_situation(table: Any) -> None:
    assert len({(row.state, row.event) for row in table.rows}) == len(table.rows)


def test_diagram_names_every_state_that_does_something() -> None:
    diagram = mermaid(UPLOAD_TABLE, UploadState.ANNOUNCED)
    assert diagram.startswith("stateDiagram-v2\n    [*] --> ANNOUNCED\n")
    assert all(state.name in diagram for state in UploadState)
    assert "CONFIRMING --> ACCEPTED: ACK_ACCEPTED" in diagram
    assert "    ACCEPTED --> [*]" in diagram
