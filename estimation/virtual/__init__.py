"""Virtual recordings with exact truth."""
