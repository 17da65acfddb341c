"""Learning from All Vehicles (Chen & Krähenbühl, CVPR 2022): models, stages, agents."""
