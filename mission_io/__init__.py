"""MAVLink missions: read, check, convert, upload, download and compare. Stands alone."""
