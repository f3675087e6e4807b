"""Options for the accuracy of photos, and for the target of a search, of ``judge-photos`` and ``verify``."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.model.detection import DetectionCurve


@dataclass(frozen=True, slots=True)
class PhotoOptions:
    """Heights of photos, and assumed errors where they record none."""

    takeoff: Annotated[
        str | None,
        typer.Option(
            "--takeoff",
            help="Take-off position of the vehicle. Photo heights are then relative to it.",
            metavar="LAT,LON",
        ),
    ] = None
    geoid_height: Annotated[
        float | None,
        typer.Option(
            "--geoid-height",
            help="Height of sea level above the ellipsoid, if PROJ has no geoid grid.",
            metavar="METRES",
        ),
    ] = None
    position_error: Annotated[
        float, typer.Option("--position-error", help="Position error of photos that state none.", metavar="METRES")
    ] = 3.0
    height_error: Annotated[
        float, typer.Option("--height-error", help="Height error of photos that state none.", metavar="METRES")
    ] = 10.0
    angle_error: Annotated[
        float,
        typer.Option("--angle-error", help="Error of the camera angles in the photos.", metavar="DEGREES"),
    ] = 2.0

    max_blur: Annotated[
        float | None,
        typer.Option(
            "--max-blur",
            help="Ignore photos in which the ground moves more than this during the exposure.",
            metavar="PIXELS",
        ),
    ] = None

    def assumed(self) -> dict[str, Any]:
        """Assumptions where photos record nothing, as arguments of `uavcover.extras.photos.placing.Assumptions`.

        Raises:
            InputError: a number is out of range.
        """
        from uavcover.errors import InputError

        for option, value in (
            ("--position-error", self.position_error), ("--height-error", self.height_error),
            ("--angle-error", self.angle_error),
        ):  # fmt: skip
            if not 0.0 <= value < 1000.0:
                raise InputError(f"{option}: {value:g} is out of range; use 0 or more")
        if self.max_blur is not None and not 0.0 < self.max_blur < 1000.0:
            raise InputError(f"--max-blur: {self.max_blur:g} is out of range; specify pixels, such as 1")
        if self.geoid_height is not None and not abs(self.geoid_height) <= 200.0:
            raise InputError(
                f"--geoid-height: {self.geoid_height:g} is out of range; it is between -110 and 90 m on Earth"
            )
        return {
            "horizontal_m": self.position_error, "vertical_m": self.height_error, "attitude_deg": self.angle_error,
            "geoid_height_m": self.geoid_height,
        }  # fmt: skip

    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude of take-off."""
        from uavcover.new.quantities import lat_lon

        return None if self.takeoff is None else lat_lon(self.takeoff, option="--takeoff")


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """Target of the search, and the required probability of detection."""

    detection: Annotated[
        str | None,
        typer.Option(
            "--detection",
            help="Detection curve: a name, your own TOML file, or list to show the names.",
            metavar="NAME|FILE.toml",
        ),
    ] = None
    pod: Annotated[
        float | None,
        typer.Option("--pod", help="Required mean probability of detection, such as 0.8."),
    ] = None

    def curve(self) -> "DetectionCurve | None":
        """Probability that one look finds the target; none without a search.

        Raises:
            InputError: it is not known, or the probability asked for is none.
        """
        from uavcover.errors import InputError
        from uavcover.new.detection import curve_named

        if self.pod is not None and not 0.0 < self.pod <= 1.0:
            raise InputError(f"--pod: {self.pod:g} is not a probability above 0 and at most 1")
        if self.detection is None:
            if self.pod is not None:
                raise InputError(
                    "--pod: this option requires --detection, the probability that one photo finds the target"
                )
            return None
        return curve_named(self.detection)


def list_curves(console: "Console") -> int:
    """Say which curves of detection come with the package."""
    from uavcover.new.detection import all_curves

    curves = all_curves()
    console.say(f"{'curve':20}{'half of the looks find it at':>30}  title")
    for one in curves:
        console.say(f"{one.name:20}{f'{100.0 * one.half_at_m:.3g} cm per pixel':>30}  {one.title}")
    console.say("These are examples and rules of thumb; measure your own curve (docs/reference/detection.md)")
    console.result({"curves": [one.name for one in curves]})
    return 0
