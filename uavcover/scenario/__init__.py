"""What is asked, and on what ground."""
