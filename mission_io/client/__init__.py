"""A ground station: who is on the link, commands, transfers."""
