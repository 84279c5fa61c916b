"""Square and elongated contacts at finite strain, by finite elements in three dimensions."""

from papers.finite_strain.solids.compare import compute, plot, tables

__all__ = ["compute", "plot", "tables"]
