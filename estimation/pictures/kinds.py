"""The marker types that can be read from pictures."""

MARKER_KINDS = ("corners", "dots", "speckle")
"""Marker types in the order of detection: the most regular first, because the cells of a
checkerboard can pass for dots, and both can pass for speckle."""
