"""Fields of a frame: rotation, strain, the contact and what sticks in it, its outline."""
