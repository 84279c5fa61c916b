"""A study of our own: slip told from pictures of the gel, judged on labelled lifts."""
