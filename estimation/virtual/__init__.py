"""Virtual recordings with known truth."""
