"""Optional features, each self-contained: the core never imports one, one never imports another (uavcover/plugins.py)."""
