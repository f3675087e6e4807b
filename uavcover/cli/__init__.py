"""The command line: the core commands; each parses, loads, calls one workflow and prints.

Begin with ``main.py``, which lists the commands of the core and of installed extras.
"""
