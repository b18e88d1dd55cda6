"""Motion that drivers fix."""
