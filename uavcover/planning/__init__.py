"""From a site to a Pareto set of routes and the selected one."""
