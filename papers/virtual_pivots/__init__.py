"""A study of our own: how accurate the estimators are on virtual pivots with exact truth."""
