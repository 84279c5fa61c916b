"""A checkerboard's x-corners: found, fitted, placed and followed."""
