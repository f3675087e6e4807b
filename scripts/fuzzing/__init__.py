"""What ``scripts/fuzz_formats.py`` tries: targets by topic with their good files, and the two engines."""
