"""Fit the softness that `estimation.softness` applies, from grasps or by pressing."""

LOAD_MODELS = ("none", "constant", "by force", "per grasp")
"""Models of L: 0, a constant, proportional to the normal force, or one value per trial."""
