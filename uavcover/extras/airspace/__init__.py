"""Formats in which no-fly zones are published: OpenAir, ED-269, ED-318.

In: the text of a file. Out: zones with heights and times, as ``uavcover.scenario.airspace.zone_file`` has them.
Each module is a reader of the group ``uavcover.zone_readers``.
"""
