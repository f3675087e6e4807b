"""Flying: a mock vehicle that speaks MAVLink, and what arms, starts, follows and records any vehicle."""
