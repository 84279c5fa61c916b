"""Recordings: what they are, their formats, their noise, and what is wrong with them."""
