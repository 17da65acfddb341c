"""Names under the import paths of the CARLA leaderboard."""
