"""Angle estimates frame by frame."""
