"""How far the object has slipped, when macro slip began, and the margin left before it begins."""
