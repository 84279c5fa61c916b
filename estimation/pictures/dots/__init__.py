"""Printed dots: detection, fit, matching and tracking."""
