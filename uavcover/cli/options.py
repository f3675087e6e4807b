"""Options that several commands share, how groups of them reach a command, and how the overview of commands is shown."""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from uavcover.errors import InputError


def option(*words: str, **more: Any) -> Any:
    """A typer option: its names where they are not the parameter's, its help, and what stands for its value there.

    >>> option("--dem", "Elevation data.", "FILE").metavar
    'FILE'
    """
    names = [word for word in words if word.startswith("-")]
    text, *metavar = words[len(names) :]
    return typer.Option(*names, help=text, metavar=metavar[0] if metavar else None, **more)


class Overview(TyperGroup):
    """The commands with the group they belong to in front; a group is what typer calls a help panel."""

    def rows(self, ctx: Any) -> Iterator[tuple[str, str, str]]:
        """Group, name and a line about each command, in their order."""
        for name in self.list_commands(ctx):
            command: Any = self.get_command(ctx, name)
            yield command.rich_help_panel, name, command.short_help

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the whole help text."""
        formatter.write(f"Usage: {ctx.command_path} [--debug] [--version] COMMAND ...\n{self.help}\n")
        group = None
        for of_group, name, short in self.rows(ctx):
            if not short:  # its neighbour's row names it: a small terminal has 24 rows
                continue
            title, group = "" if of_group == group else of_group, of_group
            formatter.write(f"{title:10}{name:15}{short}\n")
        formatter.write("COMMAND --help lists its options (all: --json, -q, -v). --install-completion\n")


if TYPE_CHECKING:
    from mission_io import SigningKey
    from uavcover.cli.console import Console
    from uavcover.flight.connect import ClientName, VehicleAddress, VehicleLink
    from uavcover.flight.orders import OnBreach

Events = Annotated[bool, option("--events", "Write messages and progress to stderr as JSON lines.")]
Json = Annotated[bool, option("--json", "Print one JSON object to stdout, and everything else to stderr.")]
Quiet = Annotated[bool, option("-q", "--quiet", "Show only warnings and errors.")]
Verbose = Annotated[int, option("-v", "--verbose", "Show log messages. Use -vv for more.", count=True)]
Force = Annotated[bool, option("--force", "Overwrite existing files.")]
ForcePlan = Annotated[bool, option("--force", "Replace an existing plan. A flown plan is moved to RUN/older-N.")]
Autopilot = Annotated[
    str | None, option("Autopilot: ardupilot or px4. Default: the scenario's autopilot.", "ardupilot|px4")
]
Seed = Annotated[int | None, option("Random seed; default: the scenario's seed.")]
Scheduler = Annotated[
    str | None,
    option(
        "Distribute the work: local:N starts N worker processes, tcp://HOST:PORT uses a Dask scheduler. It does "
        "not change the result. Requires the extra cluster.",
        "local:N|tcp://HOST:PORT",
    ),
]
To = Annotated[
    str,
    option(
        "--to",
        "URL of the vehicle: mock:, udpin://HOST:PORT (listen), udpout://HOST:PORT (send), "
        "udp:HOST:PORT, tcp:HOST:PORT or a serial port.",
        "URL",
    ),
]
ToEach = Annotated[
    list[str] | None,
    option(
        "--to",
        "URL of the vehicle: mock:, udpin://HOST:PORT (listen), udpout://HOST:PORT (send), "
        "udp:HOST:PORT, tcp:HOST:PORT or a serial port. For several vehicles, repeat the option: the "
        "first is vehicle 1. Default: the link of each [[vehicle]].",
        "URL",
    ),
]
Logs = Annotated[
    list[Path] | None,
    option(
        "--log",
        "--track",
        "Flight track: .csv, .rrd, .bin, .tlog, .ulg or .gpx. Can be repeated. Default: RUN/track.csv.",
    ),
]
LogSystem = Annotated[
    int | None, option("--system", "System ID of the vehicle, if the .tlog has several.", "N", min=1, max=255)
]
AcceptChanged = Annotated[
    list[str] | None,
    option(
        "--accept-changed",
        "Judge the flight even though this input has changed: scenario, terrain, surface, obstacles, plan, "
        "mission, track, version, record (run.json) or all. The verdict records the change. Can be repeated.",
        "WHAT",
    ),
]
Sortie = Annotated[int | None, option("--sortie", "Sortie number, if the plan has several sorties.", "N", min=1)]
Vehicles = Annotated[
    int | None,
    option(
        "--vehicles", "Number of identical vehicles that fly at the same time; default: the scenario's number.", "N"
    ),
]
Timeout = Annotated[float, option("--timeout", "Seconds to wait for the first heartbeat.", "SECONDS")]

System = Annotated[
    int | None, option("--system", "System ID of the vehicle, if several share the link.", "N", min=1, max=255)
]
SystemEach = Annotated[
    list[int] | None,
    option(
        "--system",
        "System ID of the vehicle, if several share the link. If several vehicles share one --to address, repeat this "
        "option for each.",
        "N",
        min=1,
        max=255,
    ),
]
Component = Annotated[
    int | None,
    option(
        "--component", "Component ID of the autopilot; default: 1, or that of the only autopilot.", "N", min=1, max=255
    ),
]

OwnSystem = Annotated[
    int,
    option(
        "--own-system",
        "MAVLink system ID of uavcover. Some vehicles accept commands from only one system ID.",
        "N",
        min=1,
        max=255,
    ),
]

LinkKind = Annotated[
    str,
    option(
        "--link",
        "Type of link: default, telemetry-radio or satellite. It sets the initial timeouts, which then "
        "adapt to the link.",
        "KIND",
    ),
]

SigningKeyFile = Annotated[
    Path | None,
    option(
        "--signing-key",
        "Sign all messages with the key in this file (MAVLink 2), and reject unsigned messages.",
        "FILE",
    ),
]

ClientKind = Annotated[str, option("--client", "Client for transfers and commands: native or mavsdk.", "native|mavsdk")]

RequirePhotos = Annotated[
    bool,
    option(
        "--require-photos",
        "Require photo reports from the vehicle. Without them, the flight is not proved. In flight, a missing "
        "report raises an alarm.",
    ),
]
OnBreachAction = Annotated[
    str | None,
    option(
        "--on-breach",
        "Action if the vehicle leaves the route, fence, height band or known ground, or if its mission "
        "changes: tell, hold, return or land. Default: tell; hold for a simulated vehicle.",
        "tell|hold|return|land",
    ),
]


def one_by_one(command: Callable[..., int]) -> Callable[..., int]:
    """A command as typer wants it, with one parameter for each option.

    Our commands take options that belong together as one dataclass, such as :class:`Output`. In the command that is returned each
    field of such a dataclass is a parameter of its own, in the same place; when it is called, the dataclass is made from them.
    """
    groups: dict[str, type] = {}
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(command).parameters.values():
        if isinstance(parameter.annotation, type) and dataclasses.is_dataclass(parameter.annotation):
            groups[parameter.name] = parameter.annotation
            parameters += inspect.signature(parameter.annotation).parameters.values()
        else:
            parameters.append(parameter)

    @functools.wraps(command)
    def with_groups(**values: Any) -> int:
        for name, group in groups.items():
            values[name] = group(**{field: values.pop(field) for field in inspect.signature(group).parameters})
        return command(**values)

    by_name = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in parameters]
    with_groups.__signature__ = inspect.Signature(by_name)  # type: ignore[attr-defined]
    with_groups.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return with_groups


@dataclass(frozen=True, slots=True)
class Output:
    """Output options of a command."""

    as_json: Json = False
    events: Events = False
    quiet: Quiet = False
    verbose: Verbose = 0

    def console(self) -> "Console":
        """Where the command writes to."""
        from uavcover.cli.console import Console, EventConsole

        if self.events:
            return EventConsole(as_json=self.as_json)
        return Console(as_json=self.as_json, verbosity=-1 if self.quiet else self.verbose)


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """Options of the link to a vehicle, with its timeouts."""

    timeout_s: Timeout = 10.0
    component: Component = None
    own_system: OwnSystem = 255
    signing_key: SigningKeyFile = None

    def link_at(self, address: "VehicleAddress", *, client: str = "native", link: str = "default") -> "VehicleLink":
        """The vehicle at an address.

        Raises:
            InputError: the client is not known, or cannot do what the other options ask for.
            mission_io.errors.MissionIoError: the kind of link is not known, or the signing key cannot be used.
        """
        from mission_io.links.simulated import link_preset
        from uavcover.flight.connect import VehicleLink

        name = client_name(client, link=link, signed=self.signing_key is not None)
        return VehicleLink(
            url=address.url, timeout_s=self.timeout_s, timing=link_preset(link).timing,
            signing_key=signing_key(self.signing_key), client_name=name, system_id=address.system_id,
            component_id=self.component, own_system=self.own_system,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class VehicleOptions(LinkOptions):
    """Which vehicle is meant, and how long to wait for it."""

    system: System = None

    def link_to(self, url: str, *, client: str = "native", link: str = "default") -> "VehicleLink":
        """The vehicle at ``url``; see :meth:`LinkOptions.link_at`."""
        from uavcover.flight.connect import VehicleAddress

        return self.link_at(VehicleAddress(url, self.system), client=client, link=link)


@dataclass(frozen=True, slots=True)
class EachVehicleOptions(LinkOptions):
    """Which vehicles are meant, and how long to wait for each."""

    system: SystemEach = None

    def addresses(self, urls: Sequence[str] | None) -> "list[VehicleAddress]":
        """Where the vehicles are that ``--to`` and ``--system`` name; empty where no ``--to`` is given.

        Raises:
            InputError: they do not fit each other.
        """
        from uavcover.flight.connect import given_addresses

        return given_addresses(urls, self.system)

    def links_at(
        self, addresses: "Sequence[VehicleAddress]", *, client: str = "native", link: str = "default"
    ) -> "list[VehicleLink]":
        """The vehicles at these addresses, vehicle 1 first; those on one link share it. See :meth:`LinkOptions.link_at`."""
        from uavcover.flight.connect import sharing_links

        return sharing_links([self.link_at(self._one(address), client=client, link=link) for address in addresses])

    def _one(self, address: "VehicleAddress") -> "VehicleAddress":
        """The address with the system of ``--system``, where the link is the scenario's."""
        return address._replace(system_id=self.system[0]) if self.system and len(self.system) == 1 else address


@dataclass(frozen=True, slots=True)
class TransferOptions(VehicleOptions):
    """The vehicle of a transfer, the client, and the kind of link."""

    client: ClientKind = "native"
    link: LinkKind = "default"

    def transfer_link(self, url: str) -> "VehicleLink":
        """The vehicle at ``url``; see :meth:`LinkOptions.link_at`."""
        return self.link_to(url, client=self.client, link=self.link)


def words_of(links: "Sequence[VehicleLink]") -> list[object]:
    """The options for the addresses of these vehicles."""
    systems = [link.system_id for link in links if link.system_id is not None]
    urls = [link.url for link in links]
    to = [urls[0]] if len(systems) == len(urls) and len(set(urls)) == 1 else urls
    return [word for url in to for word in ("--to", url)] + [word for each in systems for word in ("--system", each)]


def on_breach(text: str | None) -> "OnBreach | None":
    """Check what is to be done on a breach; None is the vehicle's default. Raises InputError: it is not known."""
    from uavcover.flight.orders import OnBreach

    if text is None:
        return None
    known = {action.value: action for action in OnBreach}
    if text not in known:
        raise InputError(f"--on-breach: must be tell, hold, return or land, not {text!r}")
    return known[text]


def seconds(text: str | None, *, option: str = "--budget") -> float | None:
    """A duration such as ``30s``, ``5m``, ``1h`` or ``45`` in seconds; ``option`` is named when it is none.

    Raises:
        InputError: it is none, or not above 0.
    """
    if text is None:
        return None
    number, unit = (text[:-1], text[-1]) if text[-1:] in {"s", "m", "h"} else (text, "s")
    try:
        value = float(number) * {"s": 1.0, "m": 60.0, "h": 3600.0}[unit]
    except ValueError:
        value = -1.0
    if not 0.0 < value < float("inf"):
        raise InputError(f"{option}: {text!r} is not a duration; use a format such as 30s, 5m or 1h")
    return value


def listed(text: str | None) -> list[str]:
    """The entries of a list such as ``A,B``; empty if it is not given."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def names(option: str, text: str | None, known: Iterable[str]) -> list[str]:
    """The names in a list such as ``A,B``, once each and in the order of ``known``; empty means all of them.

    Raises:
        InputError: a name is unknown, or the list is empty.
    """
    every = list(known)
    if text is None:
        return every
    requested = listed(text)
    unknown = [name for name in requested if name not in every]
    if unknown or not requested:
        what = f"unknown: {', '.join(map(repr, unknown))}" if unknown else "no name is given"
        raise InputError(f"{option}: {what}; choose from {', '.join(every)}")
    return [name for name in every if name in requested]


def signing_key(file: Path | None) -> "SigningKey | None":
    """The key in a file, if one was named.

    Raises:
        mission_io.errors.MissionIoError: it cannot be read, is no key, or others may read it.
    """
    from mission_io import SigningKey

    return None if file is None else SigningKey.from_file(file)


def client_name(text: str, *, link: str, signed: bool) -> "ClientName":
    """Check the name of a client, and that it can do what the other options ask for.

    Raises:
        InputError: it is neither, or MAVSDK lacks a requested feature.
    """
    match text:
        case "native":
            return text
        case "mavsdk":
            if signed:
                raise InputError("--client mavsdk: MAVSDK cannot sign messages; use --client native")
            if link != "default":
                raise InputError("--client mavsdk: MAVSDK's timeouts are fixed; use --client native with --link")
            return text
    raise InputError(f"--client: must be native or mavsdk, not {text!r}")
