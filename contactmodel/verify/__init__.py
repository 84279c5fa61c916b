"""`python -m contactmodel verify`: the model against closed forms, laws and itself."""
