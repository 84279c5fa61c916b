"""`python -m contactmodel simulate`: a configuration file, and what is written of its contact."""
