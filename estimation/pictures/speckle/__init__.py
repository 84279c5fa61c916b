"""Speckle patterns: subsets matched and followed."""
