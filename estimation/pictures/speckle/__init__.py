"""Speckle patterns: matching and tracking of subsets."""
