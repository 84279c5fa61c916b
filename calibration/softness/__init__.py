"""Fits of softness: what `estimation.softness` applies, found from grasps or from pressing."""

LOAD_MODELS = ("none", "constant", "by force", "per grasp")
"""How L is taken: 0, one number, in proportion to the normal force, or one for each trial."""
