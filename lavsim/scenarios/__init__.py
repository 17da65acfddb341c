"""Scripted hazards, one file each."""
