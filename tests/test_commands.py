"""What the commands of all packages share: their help comes at once, and nothing of it is cut."""

import subprocess
import sys
from importlib import import_module

import pytest

PACKAGES = ("contactmodel", "estimation", "calibration", "papers")
HEAVY = {"cv2", "jax", "matplotlib", "scipy.optimize", "scipy.spatial", "scipy.stats"}


def test_commands_are_known_without_what_they_run():
    modules = ", ".join(f"{package}.__main__" for package in PACKAGES)
    code = f"import sys, {modules}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(done.stdout.split())


@pytest.mark.parametrize("name", PACKAGES)
def test_public_names_are_there_on_demand(name):
    package = import_module(name)
    assert set(package.__all__) < set(dir(package))
    for public in package.__all__:
        assert getattr(package, public) is not None, public
    assert package.__version__.count(".") == 2
    with pytest.raises(AttributeError, match=f"'{name}' has no attribute 'no_such'"):
        package.no_such  # noqa: B018
