"""``uavcover terrain-server``: terrain heights for a vehicle that requests them."""

from dataclasses import asdict

from uavcover.cli import options
from uavcover.cli.survey_options import DemOptions


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
    from uavcover.flight.connect import connect
    from uavcover.flight.vehicle_terrain import heights_of_files, open_elevation_data, serve_terrain

    console = output.console()
    source, datum = open_elevation_data(dem.data())
    with connect(vehicle.link_to(to, link=link)) as connected:
        console.say(f"vehicle {connected.client.vehicle.system_id} at {to}: answering from {source} ({datum})")
        counts = serve_terrain(connected.client, heights_of_files(source, datum, console.warn), console)
    console.say(
        f"{counts.requests} requests for {counts.blocks} blocks: {counts.parts_sent} parts sent, "
        f"{counts.parts_unknown} not sent because data are missing"
    )
    console.result({"to": to, "dem": [str(file) for file in source.files], "vertical_datum": datum, **asdict(counts)})
    return 0
