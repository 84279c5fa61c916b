"""Frames as columns in files: LeRobot data sets and Zarr groups."""
