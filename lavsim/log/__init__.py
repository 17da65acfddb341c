"""Recorded drives: write, read, replay."""
