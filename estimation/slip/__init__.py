"""Slip of the object: its amount, the onset of macro slip, and the margin before it."""
