"""A mock vehicle that speaks MAVLink and flies without an autopilot."""
