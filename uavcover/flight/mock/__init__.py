"""A vehicle that behaves: a multirotor with an autopilot that speaks MAVLink, for tests, demos and any ground station."""
