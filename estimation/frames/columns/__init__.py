"""Frames in files of columns: LeRobot data sets and Zarr groups."""
