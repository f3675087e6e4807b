"""All targets by name; importing it imports every reader, which an engine may want to watch."""

from scripts.fuzzing import link_bytes, mission_files, picture_files, routes_and_zones
from scripts.fuzzing.target import Target

TARGETS: dict[str, Target] = {
    **mission_files.targets(), **routes_and_zones.targets(), **link_bytes.targets(), **picture_files.targets(),
}  # fmt: skip
