"""From frames of a tactile sensor to the angle of the object it holds."""
