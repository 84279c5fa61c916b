"""Fields of a frame: rotation, contact region, stick region and outline."""
