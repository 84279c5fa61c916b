"""The folder that keeps downloads and compiled programs between runs."""

import os
from pathlib import Path

from platformdirs import user_cache_dir


def cache_folder() -> Path:
    """The folder that `CONTACTMODEL_CACHE` names, else the user's cache folder of the platform."""
    chosen = os.environ.get("CONTACTMODEL_CACHE")
    return Path(chosen or user_cache_dir("contactmodel", appauthor=False))
