"""A ground station: the vehicles on the link, commands, transfers."""
