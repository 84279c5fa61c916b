"""The solver: one step of a contact, its pressure, its friction and their derivatives."""
