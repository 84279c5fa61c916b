"""`python -m contactmodel simulate`: reads a configuration, solves the contact, writes results."""
