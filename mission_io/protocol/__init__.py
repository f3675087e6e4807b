"""The MAVLink mission protocol as state machines without input or output; the clock is an argument."""
