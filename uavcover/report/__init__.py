"""Pages that open offline: the report of a run, of pictures and of a checked mission, the print-out; figures."""
