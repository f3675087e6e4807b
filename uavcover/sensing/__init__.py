"""Who sees what: cells of the area, sensors, coverage maps."""
