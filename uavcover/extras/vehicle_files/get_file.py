"""``uavcover get-file``: files from a vehicle's card, and what is in its folders, by MAVLink FTP."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission_io.model.plain_text import counted
from uavcover.cli import options
from uavcover.cli.options import option

if TYPE_CHECKING:
    from mission_io.model.items import MissionType
    from uavcover.cli.console import Console

# ``uavcover send-file``: files onto a vehicle's card, by MAVLink FTP.


def send_file(
    files: Annotated[list[Path], typer.Argument(help="Files to send, such as the .DAT files of uavcover terrain.")],
    to: options.To,
    *,
    folder: Annotated[str, option("Existing folder on the vehicle.", "PATH")] = "/APM/TERRAIN",
    window: Annotated[int, option("Number of requests in parallel. ArduPilot queues 5.", "N", min=1, max=1000)] = 5,
    vehicle: options.VehicleOptions,
    output: options.Output,
) -> int:
    """Send files to a vehicle with MAVLink FTP and compare their CRC. Existing files are replaced."""
    from mission_io.client.files import FileUploads
    from uavcover.errors import InputError
    from uavcover.flight.connect import connect

    console = output.console()
    contents: dict[str, bytes] = {}
    for file in files:
        try:
            contents[f"{folder.rstrip('/')}/{file.name}"] = file.read_bytes()
        except OSError as error:
            raise InputError(f"{file}: the file cannot be read ({error.strerror or error})") from error
    if len(contents) < len(files):
        raise InputError("two of the files have the same name; send them separately, with different --folder options")
    with connect(vehicle.link_to(to)) as connected:
        if connected.client.vehicle.armed:
            raise InputError(
                f"vehicle {connected.client.vehicle.system_id} is armed; send files only while it is "
                "disarmed on the ground"
            )
        uploads = FileUploads(connected.client, window=window)
        for path, content in contents.items():
            with console.progress(f"sending {path}") as bar:
                uploads.upload(path, content, progress=bar.count)
            console.say(f"sent {path} ({len(content)} bytes, CRC equal)")
    console.result({"to": to, "files": {path: len(content) for path, content in contents.items()}})
    return 0


_CONVERTED = (".waypoints", ".plan")


def get_file(
    path: Annotated[str, typer.Argument(help="File on the vehicle; or, with a slash at the end, a folder to list.")],
    to: options.To,
    *,
    out: Annotated[
        Path | None,
        option("-o", "--out", "Output file; default: the same name in the current folder.", "FILE"),
    ] = None,
    window: Annotated[int, option("Number of reads in parallel. ArduPilot queues 5.", "N", min=1, max=1000)] = 5,
    vehicle: options.VehicleOptions,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Download a file from a vehicle with MAVLink FTP and compare its CRC, or list a folder.

    A PATH that ends with a slash is a folder. ArduPilot's @MISSION/mission.dat, fence.dat and rally.dat become a
    .waypoints or .plan file if -o names one.
    """
    from mission_io.client.files import FileDownloads
    from uavcover.errors import InputError, OutputError
    from uavcover.flight.connect import connect
    from uavcover.run.file_group import write_file

    console = output.console()
    if path.endswith("/"):
        if out is not None:
            raise InputError(f"{path}: this is a folder, which is only listed; omit -o, or specify a file")
        with connect(vehicle.link_to(to)) as connected:
            entries = FileDownloads(connected.client).entries(path)
        for entry in entries:
            size = "folder" if entry.is_folder else "?" if entry.size_bytes is None else str(entry.size_bytes)
            console.say(f"{size:>12}  {_printable(entry.name)}")
        console.say(f"{counted(len(entries), 'entry', 'entries')} in {path}")
        listed = [{"name": e.name, "folder": e.is_folder, "bytes": e.size_bytes} for e in entries]
        console.result({"from": to, "path": path, "entries": listed})
        return 0
    name = path.rsplit("/", 1)[-1]
    file = Path(name) if out is None else out
    if name in {"", ".", ".."} or "\0" in path:
        raise InputError(f"{path!r} is not a file name; a folder to list ends with a slash")
    if file.is_dir():
        raise OutputError(f"{file}: this is a folder; specify a file with -o")
    if file.exists() and not force:
        raise OutputError(f"{file} already exists; use --force to overwrite it, or choose another name with -o")
    if not file.parent.is_dir():
        raise OutputError(f"{file.parent}: this is not a folder; create it first")
    if file.suffix in _CONVERTED and (listed_as := _list_of(path)) is not None:
        text, items = _converted(vehicle, to, listed_as, file, console)
        write_file(file, text.encode())
        console.say(f"wrote {file} ({counted(items, 'item')} of {path})")
        console.result({"from": to, "path": path, "file": str(file), "items": items})
        return 0
    with connect(vehicle.link_to(to)) as connected, console.progress(f"getting {path}") as bar:
        content = FileDownloads(connected.client, window=window).download(path, progress=bar.count)
    write_file(file, content)
    console.say(f"wrote {file} ({len(content)} bytes, CRC equal)")
    console.result({"from": to, "path": path, "file": str(file), "bytes": len(content)})
    return 0


def _list_of(path: str) -> "MissionType | None":
    """Name of ArduPilot's list that a path is the file of; None for any other file."""
    from mission_io.formats.wpl import dat_path
    from mission_io.model.items import MissionType

    return next((kind for kind in MissionType if path.lstrip("/").casefold() == dat_path(kind).casefold()), None)


def _converted(
    vehicle: options.VehicleOptions, to: str, kind: "MissionType", file: Path, console: "Console"
) -> tuple[str, int]:
    """A list as the text of a mission file, and how many items it has. Files need the home, which the mission has."""
    from mission_io.autopilots.mission_lists import mission_list_of
    from mission_io.client.files import FileDownloads
    from mission_io.model.items import MissionType
    from uavcover.cli.transfers import text_of
    from uavcover.flight.connect import connect

    with connect(vehicle.link_to(to)) as connected, console.progress("downloading the list") as bar:
        files, autopilot = FileDownloads(connected.client), connected.client.vehicle.autopilot
        wanted = dict.fromkeys((MissionType.MISSION, kind))
        lists = {t: mission_list_of(t, files.mission_items(t, progress=bar.count), autopilot) for t in wanted}
        return text_of(connected.client, lists, file, kind.name.lower())


def _printable(name: str) -> str:
    """A name as a terminal may show it: what a vehicle sends could hold control characters."""
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in name)
