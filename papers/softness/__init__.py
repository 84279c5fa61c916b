"""What a fitted k mends: virtual objects on a half-space, a real pivot finger against finger."""
