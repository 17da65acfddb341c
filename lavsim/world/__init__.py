"""State of the world and what moves it: dynamics, contacts, lights, weather, snapshots."""
