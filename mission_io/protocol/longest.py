"""Upper bounds on the duration of the client's calls, whatever the vehicle does.

Every exchange has a deadline that only progress moves: ``Timing.no_progress_s`` after it last got further than ever,
where "further" means one more item held (download) or one more item requested (upload). Restarts, at most ``RESTARTS``,
add only the time needed to get as far again. The round-trip time of the link does not matter while it is shorter than
``no_progress_s``.
"""

from dataclasses import dataclass

from mission_io.protocol.exchange import RESTARTS, Timing

CLEAR_TRIES = 3
"""Number of attempts of ``Client.clear`` when the vehicle acknowledges without clearing."""

READINGS = 2
"""Number of times a differing list is read back."""

STALE_READ_BACK_S = 0.1
"""The pause between them."""


@dataclass(frozen=True, slots=True)
class LongestTimes:
    """Bounds in seconds, reached only by a hostile vehicle.

    Attributes:
        stuck_s: From the last progress of a transfer to its end.
        download_s: ``Client.download``.
        upload_s: ``Client.upload``, with reading back what the vehicle holds when it fails.
        verified_upload_s: ``Client.upload_and_verify`` of a list within the known item limit.
        clear_s: ``Client.clear``, with reading back.
    """

    stuck_s: float
    download_s: float
    upload_s: float
    verified_upload_s: float
    clear_s: float


def longest_times(timing: Timing, item_count: int) -> LongestTimes:
    """The bounds for at most ``item_count`` items transferred in either direction.

    A vehicle may take almost ``no_progress_s`` for each item and still progress, so the bounds grow with the number of items;
    for a vehicle that announces 65,535 items and sends three, the time for three applies.
    """
    steps = item_count + 1  # the count, and then each item
    restarts_s = RESTARTS * steps * timing.resend_longest_s
    waits_s = max(timing.busy_retry_s, timing.doubt_s, timing.recheck_s)
    stuck_s = timing.no_progress_s + restarts_s + waits_s
    transfer_s = steps * timing.no_progress_s + stuck_s
    reading_s = READINGS * transfer_s + STALE_READ_BACK_S
    upload_s = transfer_s + timing.linger_s + reading_s
    clearing_s = timing.no_progress_s + timing.busy_retry_s
    return LongestTimes(
        stuck_s=stuck_s,
        download_s=transfer_s,
        upload_s=upload_s,
        verified_upload_s=upload_s + reading_s,
        clear_s=CLEAR_TRIES * (clearing_s + transfer_s),
    )
