"""From a site to a set of routes and the one that is handed over."""
