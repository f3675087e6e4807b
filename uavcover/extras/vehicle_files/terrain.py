"""``uavcover terrain``: the elevation data that an area needs, and ArduPilot's terrain files of it."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer

from mission_io.model.plain_text import counted
from uavcover.cli import options
from uavcover.cli.new import DemOptions
from uavcover.cli.options import option

# ``uavcover terrain-server``: terrain heights for a vehicle that requests them.


def terrain_server(
    to: options.To,
    *,
    dem: DemOptions,
    vehicle: options.VehicleOptions,
    link: options.LinkKind = "default",
    output: options.Output,
) -> int:
    """Answer the terrain requests of a vehicle until Ctrl-C.

    ArduPilot arms for a mission with heights above terrain only if it has received this data. Heights are in whole
    metres. Blocks without elevation data are not sent. fly and plan-upload answer requests with the data of their
    scenario, so they do not need this command.
    """
    from uavcover.cli.new import open_elevation_data
    from uavcover.extras.vehicle_files.terrain_heights import serve_terrain
    from uavcover.flight.connect import connect, heights_of_files

    console = output.console()
    source, datum = open_elevation_data(dem.data())
    with connect(vehicle.link_to(to, link=link)) as connected:
        console.say(f"vehicle {connected.client.vehicle.system_id} at {to}: answering from {source} ({datum})")
        counts = serve_terrain(connected.client, heights_of_files(source, datum, console.warn), console)
    console.say(
        f"requests: {counts.requests} for {counted(counts.blocks, 'block')}; sent parts: {counts.parts_sent}; parts not sent "
        f"because data is missing: {counts.parts_unknown}"
    )
    console.result({"to": to, "dem": [str(file) for file in source.files], "vertical_datum": datum, **asdict(counts)})
    return 0


@dataclass(frozen=True, slots=True)
class AreaOptions:
    """Options for reading the area's file, and for the ground around it."""

    around: Annotated[str, option("Distance around the area to include.", "LENGTH")] = "1km"
    layer: Annotated[str | None, option("Layer or folder in the area file.")] = None
    feature: Annotated[str | None, option("Name or number (from 1) of a feature in the area file.")] = None
    crs: Annotated[
        str | None,
        option("Coordinate system of the area file, if the file does not state it.", "EPSG:N"),
    ] = None
    make_valid: Annotated[bool, option("--make-valid", "Repair outlines that cross themselves.")] = False
    swap_axes: Annotated[bool, option("--swap-axes", "Read coordinates in the area file as latitude first.")] = False


def terrain(
    area: Annotated[str, typer.Argument(help="Area: a file; WEST,SOUTH,EAST,NORTH; or LAT,LON,RADIUS.")],
    *,
    dem: DemOptions,
    where: AreaOptions,
    dat: Annotated[Path | None, option("Write ArduPilot terrain files to this folder.", "FOLDER")] = None,
    spacing: Annotated[int, option("The vehicle's TERRAIN_SPACING, for --dat.", "METRES")] = 100,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """List the tiles of free elevation data sets that an area needs. Nothing is downloaded.

    With --dem, the command checks whether these files cover the area, and exits with 1 if they do not. With --dat, it
    writes .DAT files for the folder APM/TERRAIN on the card of the vehicle.
    """
    from uavcover.cli.new import open_elevation_data
    from uavcover.errors import InputError
    from uavcover.extras.vehicle_files.area_terrain import files_in, known_fraction, print_needed, terrain_of_area
    from uavcover.extras.vehicle_files.terrain_heights import write_terrain_files
    from uavcover.flight.connect import heights_of_files
    from uavcover.new.quantities import length_m
    from uavcover.run.user import to_paste
    from uavcover.scenario.areas.area_file import AreaQuery

    console = output.console()
    data = dem.data()
    if dat is not None and not data.names:
        raise InputError("--dat: this option requires elevation data; add --dem")
    query = AreaQuery(
        source=area, layer=where.layer, feature=where.feature, crs=where.crs, make_valid=where.make_valid,
        swap_axes=where.swap_axes,
    )  # fmt: skip
    found = terrain_of_area(query, around_m=length_m(where.around, option="--around", example="1km"))
    there = files_in(data.names) if data.names else None
    document: dict[str, object] = {"area": area, "sets": print_needed(found, there, console)}
    document["national"] = [{"title": one.title, "address": one.address} for one in found.national]
    if there is None:
        console.suggest(to_paste("terrain", area.strip(), "--dem", "FOLDER"))
        console.result(document)
        return 0
    fraction = known_fraction(found, data, console)
    console.say(f"{', '.join(data.names)}: contains heights for {100.0 * fraction:.1f} % of the area")
    document["known_share"] = fraction
    if dat is not None:
        source, datum = open_elevation_data(data, around=found.around)
        heights = heights_of_files(source, datum, console.warn)
        written = write_terrain_files(heights, found.around, dat, spacing_m=spacing, force=force, user=console)
        for name, blocks in written.items():
            console.say(f"wrote {dat / name} ({counted(blocks, 'block')})")
        document["dat"] = {str(dat / name): blocks for name, blocks in written.items()}
    console.result(document)
    return 0 if fraction == 1.0 else 1
