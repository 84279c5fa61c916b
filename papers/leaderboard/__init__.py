"""A benchmark for methods of any group: recordings in three tiers, scored by right answers."""
