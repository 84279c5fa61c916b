"""Pictures of a sensor's markers: rendering them, and reading marker positions from them."""
