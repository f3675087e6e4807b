"""What the options of ``fly`` say about breaches and limits, and where a vehicle's old parameters are kept meanwhile."""

import json
import math
import sys
from collections.abc import Mapping

from uavcover.cli.console import Console
from uavcover.errors import InputError
from uavcover.run.folder import RunFolder
from uavcover.vehicle.precautions import OnBreach, Precautions

OLD_LIMITS = "limits_before.json"
"""There while a flight has changed parameters: after a kill the next flight finds it."""


def precautions_for(
    run: RunFolder, console: Console, *, on_breach: OnBreach | None, apply_limits: bool, agreed: bool
) -> Precautions:
    """The precautions of a flight of this run.

    Args:
        run: where old parameters are kept.
        console: tells what is asked.
        on_breach: what to do on a breach; None is the vehicle's default.
        apply_limits: whether to set what the plan needs.
        agreed: whether the user has agreed beforehand.

    Raises:
        InputError: what an earlier flight left is no list of parameters.
    """

    def keep(values: Mapping[str, float]) -> None:
        if values:
            run.write_json(OLD_LIMITS, dict(values))
        else:
            run.remove([OLD_LIMITS])

    def agree(text: str) -> bool:
        console.say(text)
        if agreed:
            return True
        if not sys.stdin.isatty():
            console.warn("--apply-limits has nobody to ask here; say --yes with it")
            return False
        sys.stderr.write("set them? [y/N] ")
        sys.stderr.flush()
        return sys.stdin.readline().strip().lower() in ("y", "yes")

    return Precautions(
        on_breach=on_breach, apply_limits=apply_limits, agree=agree, keep=keep, left_changed=_left_changed(run)
    )


def _left_changed(run: RunFolder) -> dict[str, float]:
    file = run.file(OLD_LIMITS)
    if not file.exists():
        return {}
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
        found = {str(name): float(value) for name, value in values.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        found = {"": math.nan}
    if not all(name and math.isfinite(value) for name, value in found.items()):
        raise InputError(
            f"{file}: holds the parameters that an earlier flight changed on the vehicle, and cannot be read; set them by hand, "
            "then remove it"
        )
    return found
