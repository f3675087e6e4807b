"""From people's own files and words to a scenario: cameras, vehicles, the design of a survey, and its TOML with reasons."""
