"""All methods on the same recordings: virtual pivots with exact truth, and real ones at hand."""
