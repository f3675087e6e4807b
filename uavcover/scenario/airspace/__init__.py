"""No-fly zones: read from files, and in the local frame."""
