"""Sizes and times of recordings; ``data/recording.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scene:
    max_nodes_per_side: int
    texture_pixels: int
    max_labels: int
    outline_pieces_per_side: int
    tick_s: float
    tile_side_cells: int
    directions: int
    steps: int
    level_cos: float
    vehicle_step_s: float
    heading_share: float
    camera_edges: int
    piece_s: float
    longest_name: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Views:
    played_in_s: float
    tile_pixels: float
    map_pixels: float
    link_window_s: float
    period_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Viewer:
    start_timeout_s: float
    load_timeout_s: float
    poll_s: float
    settle_s: float
    ending_s: float


SCENE = data_table(_Scene, "uavcover/data/recording.toml", "scene")
VIEWS = data_table(_Views, "uavcover/data/recording.toml", "views")
VIEWER = data_table(_Viewer, "uavcover/data/recording.toml", "viewer")
