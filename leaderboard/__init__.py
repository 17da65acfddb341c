"""Scores agents as the CARLA leaderboard does; the package name is the one published agents import."""
