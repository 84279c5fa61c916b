"""Helpers shared by all four packages: files, checks, commands, versions."""
