"""Cubes, ellipsoids, square pads and bars at finite strain: model, angles and bars compared."""

from papers.finite_strain.solids.compare import compute, plot, tables

__all__ = ["compute", "plot", "tables"]
