import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.__main__ import app
from estimation.sources import write_archive
from tests.cases import lift


@pytest.fixture(scope="module")
def at_rest(tmp_path_factory):
    path = tmp_path_factory.mktemp("rest") / "rest.npz"
    write_archive(lift(np.zeros(0), unloaded=60), path)
    return path


def test_noise_of_a_sensor_at_rest(at_rest, tmp_path):
    result = CliRunner().invoke(app, ["noise", str(at_rest), "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    found = tomllib.loads((tmp_path / "noise.toml").read_text())
    assert found["in_plane_mm"] == pytest.approx(1e-3, rel=0.05)  # 24000 samples
