"""From a scenario file to a site: areas, no-fly zones, obstacles and limits.

In: TOML and the files that it names. Out: ``Scenario`` and ``Site``. Begin with ``scenario_file.py`` and ``site.py``.
"""
