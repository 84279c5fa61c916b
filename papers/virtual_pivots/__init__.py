"""A study of our own: accuracy of the estimators on virtual pivots with exact truth."""
