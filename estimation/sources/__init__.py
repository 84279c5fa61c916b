"""Readers: what sensors and archives write, as a `Recording`."""
