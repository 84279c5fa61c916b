"""A benchmark that others enter: recordings in three tiers, and the share of right answers."""
