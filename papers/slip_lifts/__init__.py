"""A study of our own: slip detection from pictures of the gel, scored on labelled lifts."""
