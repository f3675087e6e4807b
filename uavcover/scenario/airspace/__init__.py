"""No-fly zones: read from people's and authorities' files, and in the local frame."""
