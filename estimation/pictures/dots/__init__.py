"""Printed dots: found, fitted, matched and followed."""
