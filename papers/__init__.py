"""Published results regenerated, and studies of our own."""
