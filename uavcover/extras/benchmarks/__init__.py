"""The paper's tables, planners, optimizers and links compared: ``uavcover bench``.

In: scenarios, problems, data folders that the user names. Out: tables and runs as CSV and Markdown, kept from run to run.
Begin with ``command.py``; each benchmark is a folder of its own.
"""

COMMANDS = {"Measure": {"bench": ("uavcover.extras.benchmarks.command", "run the benchmarks of this project", ())}}
