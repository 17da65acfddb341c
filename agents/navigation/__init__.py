"""Names under the import paths of the CARLA Python agents."""
