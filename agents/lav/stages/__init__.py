"""Stages of LAV's training, one file each, found by name."""
