"""Driving agents; `lavsim score --agent agents.x:Class` or a file finds one."""
