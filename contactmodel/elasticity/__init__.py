"""How the two bodies give way: their laws, and the displacement of a grid's cells."""
