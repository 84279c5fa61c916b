"""What has slipped, when macro slip began, and what is left before it."""
