"""What ArduPilot and PX4 do differently, as data."""
