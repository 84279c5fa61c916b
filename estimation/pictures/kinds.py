"""The kinds of markers that can be read from pictures."""

MARKER_KINDS = ("corners", "dots", "speckle")
"""In the order in which they are looked for: the most regular first, since the cells of a
checkerboard can pass for dots, and either for a texture."""
