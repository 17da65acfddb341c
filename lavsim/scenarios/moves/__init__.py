"""Small moves that the scripts of hazards are put together from."""
