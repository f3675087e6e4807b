"""``report.html``: one page about a run that opens offline.

In: a run folder. Out: HTML with map, charts, tables. Begin with ``page.py``; ``content.py`` reads the run.
"""
