"""What a run writes: tables, pictures, reports and videos."""
