"""Bundled towns, found by name, and the scripts that draw them."""
