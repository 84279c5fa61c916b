"""Second opinion: an independent code on the same problem, where it is installed."""

import numpy as np
import pytest

from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Rigid, solve_contact


def test_normal_contact_against_tamaas():
    tamaas = pytest.importorskip("tamaas")
    cells, size, radius, young, poisson_ratio = 64, 10.0, 20.0, 1.0, 0.3
    grid = Grid((cells, cells), (size, size))
    body = HalfSpace(shear_modulus=young / (2 * (1 + poisson_ratio)), poisson_ratio=poisson_ratio)
    ours = solve_contact(
        Contact(body, Rigid(), Paraboloid(radius), grid, 0.0), Pose(approach=0.3), rtol=1e-10
    )
    x, y = grid.points
    model = tamaas.ModelFactory.createModel(
        tamaas.model_type.basic_2d, [size, size], [cells, cells]
    )
    model.E, model.nu = young, poisson_ratio
    tamaas.ModelFactory.registerNonPeriodic(model, "dcfft")
    solver = tamaas.PolonskyKeerRey(model, -(x**2 + y**2) / (2 * radius), 1e-12)
    solver.setIntegralOperator("dcfft")
    pressure = np.asarray(ours.pressure)
    solver.solve(float(pressure.sum()) * grid.cell_area / size**2)
    # both take pressure as constant in each cell; the solvers' tolerances are left
    np.testing.assert_allclose(
        np.asarray(model.traction), pressure, atol=1e-6 * float(pressure.max())
    )
