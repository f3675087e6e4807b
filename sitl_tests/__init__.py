"""The same checks on every vehicle there is: the mock, ArduCopter and PX4; see ``docs/how-to/sitl.md``."""
