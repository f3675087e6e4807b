"""Areas from the user's files: one reader for every format and coordinate system."""
