"""A mock vehicle that speaks MAVLink and flies without an autopilot.

In: MAVLink messages, time. Out: MAVLink messages. Begin with ``vehicle.py``; faults are data (``faults.py``).
"""
