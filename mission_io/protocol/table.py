"""A state machine's transitions as one table: looked up by the machine, drawn by the documentation."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from mission_io.errors import MissionIoError

StateT = TypeVar("StateT", bound=Enum)
EventT = TypeVar("EventT", bound=Enum)


class MissingRowError(MissionIoError):
    """A transition table has no row for what happened: a mistake in this package, not of the peer."""


@dataclass(frozen=True, slots=True)
class Row(Generic[StateT, EventT]):
    """In ``state``, when ``event`` happens: do ``action`` (empty: nothing) and be in ``next_state``."""

    state: StateT
    event: EventT
    next_state: StateT
    action: str = ""


class Table(Generic[StateT, EventT]):
    """Rows by state and event. What is legal and changes nothing, such as a duplicate, has a row too."""

    def __init__(self, rows: Iterable[Row[StateT, EventT]]) -> None:
        self.rows = tuple(rows)
        self._rows = {(row.state, row.event): row for row in self.rows}

    def row(self, state: StateT, event: EventT) -> Row[StateT, EventT]:
        """The row for an event in a state.

        Raises:
            MissingRowError: the table has none.
        """
        try:
            return self._rows[state, event]
        except KeyError:
            raise MissingRowError(f"no transition for {event.name} in {state.name}") from None


def staying(states: Iterable[StateT], events: Iterable[EventT]) -> list[Row[StateT, EventT]]:
    """Rows for events that change nothing in these states."""
    events = tuple(events)
    return [Row(state, event, state) for state in states for event in events]


def mermaid(table: Table[StateT, EventT], start: StateT) -> str:
    """The table as a Mermaid state diagram; events that change nothing are left out."""
    lines = ["stateDiagram-v2", f"    [*] --> {start.name}"]
    arrows: dict[tuple[str, str, str], list[str]] = {}
    for row in table.rows:
        if row.state is not row.next_state or row.action:
            arrows.setdefault((row.state.name, row.next_state.name, row.action), []).append(row.event.name)
    for (state, next_state, action), events in arrows.items():
        lines.append(f"    {state} --> {next_state}: {', '.join(events)}" + (f" / {action}" if action else ""))
    sources = {row.state for row in table.rows}
    ends = dict.fromkeys(row.next_state.name for row in table.rows if row.next_state not in sources)
    lines.extend(f"    {end} --> [*]" for end in ends)
    return "\n".join(lines)
