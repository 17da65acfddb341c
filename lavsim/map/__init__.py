"""OpenDRIVE towns: import, queries, routes and static scenery."""
