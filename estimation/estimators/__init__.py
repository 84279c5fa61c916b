"""Estimators: from the fields of one frame to the object's angle."""
