"""The command line: one command a file, each parses, loads, calls and writes."""
