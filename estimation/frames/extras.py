"""Optional dependencies ("extras") of the distribution."""

from importlib.util import find_spec

EXTRA_PACKAGES: dict[str, tuple[str, ...]] = {
    "peers": ("trackpy",),
    "video": ("av",),
    "bags": ("mcap", "rosbags"),
    "lerobot": ("pyarrow",),
    "zarr": ("zarr",),
    "tac3d": ("ruamel",),
    "finite-elements": ("skfem",),
    "view": ("rerun",),
    "sweeps": ("dask", "distributed", "zarr"),
}
"""Import names of the packages that each extra installs."""


class MissingExtraError(ModuleNotFoundError, ValueError):
    """Packages of an extra are not installed; the message gives the command that installs them."""


def require_extra(extra: str, job: str) -> None:
    """Check that the packages of an extra are installed, without importing them.

    Args:
        extra: one of `EXTRA_PACKAGES`.
        job: subject of the message: the activity that needs the packages.

    Raises:
        MissingExtraError: a package is not installed.
    """
    if absent := [package for package in EXTRA_PACKAGES[extra] if find_spec(package) is None]:
        raise MissingExtraError(
            f"{job} needs {', '.join(absent)} (not installed): "
            f'run `pip install "contactmodel[{extra}]"`'
        )
