"""Run folders, and the workflows that commands, scripts and the Python API share."""
