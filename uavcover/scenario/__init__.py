"""What is asked, and where: the scenario file, areas, no-fly zones, the site that loads them all.

In: TOML and the files that it names. Out: ``Scenario`` and ``Site``. Begin with ``scenario_file.py`` and ``site.py``.
"""
