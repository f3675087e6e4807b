"""Asks vehicles and ground stations for the cases of the MAVLink mission protocol, and judges what they do.

``python -m mission_io.conformance URL`` asks a vehicle, ``--serve URL`` is a vehicle that misbehaves on purpose and judges
the ground station that talks to it. See docs/reference/conformance.md.
"""
