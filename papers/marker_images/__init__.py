"""A study of our own: how accurate markers are read from pictures with exact truth."""
