"""Planning of large areas by parts: divided, each part planned by itself, joined, and mended along the seams."""
