"""Sinks for answers, in addition to the table and the record of every run."""
