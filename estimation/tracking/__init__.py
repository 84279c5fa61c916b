"""Follows the angle frame by frame."""
