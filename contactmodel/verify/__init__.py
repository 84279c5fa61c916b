"""`python -m contactmodel verify`: the solver against closed forms, laws and convergence."""
