"""Cubes, ellipsoids and square pads at finite strain: the contact model, angles, square bars."""

from papers.finite_strain.solids.compare import compute, plot, tables

__all__ = ["compute", "plot", "tables"]
