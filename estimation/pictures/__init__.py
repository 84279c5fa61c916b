"""Pictures of a sensor's markers: rendered, and turned into marker positions."""
