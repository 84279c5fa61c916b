"""A study of our own: how accurately markers are read from pictures with exact truth."""
