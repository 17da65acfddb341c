"""Agents to measure others by: each leaves out something that the expert does."""
