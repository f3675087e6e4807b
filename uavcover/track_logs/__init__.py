"""Flown tracks from the logs of other software: dataflash, telemetry, ULog, GPX."""
