"""Kinds of links by name: how patient transfers are on one, and how it treats datagrams when it is simulated.

Time-outs adapt to the link by themselves; a preset saves the first seconds and gives slow links more time.
"""

from dataclasses import dataclass
from typing import Final

from mission_io.errors import MisuseError
from mission_io.links.simulated import Conditions
from mission_io.protocol.timing import Timing


@dataclass(frozen=True, slots=True)
class LinkPreset:
    """A kind of link.

    Attributes:
        name: Its name in options.
        timing: For ``Client(timing=...)``.
        conditions: For ``SimulatedLink(conditions=...)``: such a link on a bad day, each way.
    """

    name: str
    timing: Timing
    conditions: Conditions


DEFAULT: Final = LinkPreset("default", Timing(), Conditions(loss=0.01, delay_s=0.005, jitter_s=0.005))
"""A cable, a network, a good radio."""

TELEMETRY_RADIO: Final = LinkPreset(
    "telemetry-radio",
    Timing(resend_s=0.5, resend_shortest_s=0.05, resend_longest_s=1.5, stall_s=8.0, give_up_s=25.0, linger_s=2.0),
    Conditions(
        loss=0.05,
        duplication=0.01,
        corruption=0.02,
        delay_s=0.04,
        jitter_s=0.06,
        bytes_per_s=57_600 / 10,  # a start and a stop bit for each byte
        queue_bytes=2_000,
    ),
)
"""A serial radio at 57,600 baud."""

SATELLITE: Final = LinkPreset(
    "satellite",
    Timing(
        resend_s=1.0,
        resend_shortest_s=0.3,
        resend_longest_s=3.0,
        items_ahead=4,
        stall_s=12.0,
        give_up_s=40.0,
        busy_retry_s=1.5,
        busy_give_up_s=30.0,
        doubt_s=5.0,
        recheck_s=2.5,
        linger_s=2.5,
    ),
    Conditions(
        loss=0.03,
        duplication=0.01,
        corruption=0.01,
        delay_s=0.3,
        jitter_s=0.05,
        bytes_per_s=2_400.0,
        queue_bytes=4_000,
    ),
)
"""A satellite link: 600 ms round trip and little bandwidth."""

LINK_PRESETS: Final = {preset.name: preset for preset in (DEFAULT, TELEMETRY_RADIO, SATELLITE)}
"""By name."""


def link_preset(name: str) -> LinkPreset:
    """Look a preset up by name.

    Raises:
        MisuseError: an unknown name; the message lists the known ones.
    """
    try:
        return LINK_PRESETS[name]
    except KeyError:
        raise MisuseError(f"{name!r} is no kind of link; there are {', '.join(LINK_PRESETS)}") from None
