"""Areas from people's own files: one reader for every format, any coordinate system."""
