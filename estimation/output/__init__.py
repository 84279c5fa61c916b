"""Output of a run: tables, figures, reports and videos."""
