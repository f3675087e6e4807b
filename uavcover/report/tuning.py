"""Sizes of the report's drawings; ``data/report.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Figures:
    dpi: int
    side_nodes: int
    top_nodes: int
    max_numbers: int
    relief_pixels: int
    jpeg_quality: int
    surface_nodes: int
    max_samples: int
    pad_m: float
    ramp_steps: int
    max_table_rows: int
    along_steps: int
    flight_colors: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Background:
    pixels: int
    quality: int
    nodes: int
    most_tiles: int


FIGURES = data_table(_Figures, "uavcover/data/report.toml", "figures")
BACKGROUND = data_table(_Background, "uavcover/data/report.toml", "background")
