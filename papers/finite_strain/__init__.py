"""Error of the linear contact model at finite strain, against our own finite elements."""
