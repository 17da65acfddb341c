"""Datasets: what is kept of drives for training, and the tools around them."""
