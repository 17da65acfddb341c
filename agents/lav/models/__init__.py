"""Networks of LAV, every size from `LavConfig`."""
