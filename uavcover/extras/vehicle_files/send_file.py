"""``uavcover send-file``: files onto a vehicle's card, by MAVLink FTP."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def send_file(
    files: Annotated[list[Path], typer.Argument(help="Files to send, such as the .DAT files of uavcover terrain.")],
    to: options.To,
    *,
    folder: Annotated[
        str, typer.Option("--folder", help="Existing folder on the vehicle.", metavar="PATH")
    ] = "/APM/TERRAIN",
    window: Annotated[
        int,
        typer.Option("--window", help="Number of parallel requests. ArduPilot queues 5.", metavar="N", min=1, max=1000),
    ] = 5,
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
        raise InputError("two of the files have the same name; send them separately with --folder")
    with connect(vehicle.link_to(to)) as connected:
        if connected.client.vehicle.armed:
            raise InputError(f"vehicle {connected.client.vehicle.system_id} is armed; send files on the ground")
        uploads = FileUploads(connected.client, window=window)
        for path, content in contents.items():
            with console.progress(f"sending {path}") as bar:
                uploads.upload(path, content, progress=bar.count)
            console.say(f"sent: {path} ({len(content)} bytes, CRC equal)")
    console.result({"to": to, "files": {path: len(content) for path, content in contents.items()}})
    return 0
