"""Test vehicles and ground stations against the MAVLink mission protocol, case by case.

``python -m mission_io.conformance URL`` tests a vehicle. ``--serve URL`` is a vehicle that misbehaves on purpose, and judges the
connected ground station. See docs/reference/conformance.md.
"""
