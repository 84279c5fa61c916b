"""A study of our own: where the source paper's equations hold, where not, and by how much."""
