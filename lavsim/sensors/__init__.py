"""Sensors, one file each: stateless functions of snapshots."""
