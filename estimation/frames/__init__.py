"""Recordings: their data, formats, inspection and noise."""
