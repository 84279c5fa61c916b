"""Damaged inputs for every reader: `python -m tests.fuzz --cases N --seed S`."""
