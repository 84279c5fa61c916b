"""The x-corners of a checkerboard: detection, fit, placing and tracking."""
