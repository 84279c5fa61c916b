"""The gain of a fitted k: virtual objects on a half-space, and a real pivot with two fingers."""
