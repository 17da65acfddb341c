"""Packaged route files, found by name (`lavsim score --routes quick`)."""
