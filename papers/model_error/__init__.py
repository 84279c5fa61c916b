"""A study of our own: where the source paper's equations hold, and their errors elsewhere."""
