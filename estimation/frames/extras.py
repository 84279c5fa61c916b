"""Extras of the distribution: packages that only some jobs need."""

from importlib.util import find_spec

EXTRAS: dict[str, tuple[str, ...]] = {
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
"""Packages that each extra installs, by the name they are imported under."""


class MissingExtraError(ModuleNotFoundError, ValueError):
    """A job needs packages that are not installed; the message says how to install them."""


def require_extra(extra: str, job: str) -> None:
    """Check that the packages of an extra are installed, without importing them.

    Args:
        extra: one of `EXTRAS`.
        job: what needs the packages; the subject of the message.

    Raises:
        MissingExtraError: a package is not installed.
    """
    if absent := [package for package in EXTRAS[extra] if find_spec(package) is None]:
        raise MissingExtraError(
            f"{job} needs {', '.join(absent)} (not installed): "
            f'run `pip install "contactmodel[{extra}]"`'
        )
