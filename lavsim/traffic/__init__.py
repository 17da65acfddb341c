"""Drivers and walkers as array kernels."""
