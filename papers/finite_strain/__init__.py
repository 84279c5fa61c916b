"""Error of the linear contact model at finite strain, against finite elements of our own."""
