"""What sensors and pictures see: ground class rasters and prisms."""
