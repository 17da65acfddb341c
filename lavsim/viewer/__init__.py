"""Recorded drives for people: a replay that a browser opens, and films."""
