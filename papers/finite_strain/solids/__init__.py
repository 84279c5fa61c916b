"""Square and elongated contacts at finite strain, by finite elements in three dimensions."""
