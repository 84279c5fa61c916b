"""What is found out about a sensor beforehand, before it is trusted with angles."""
