"""Where downloads and compiled programs are kept from one run to the next."""

import os
from pathlib import Path

from platformdirs import user_cache_dir


def cache_folder() -> Path:
    """The folder that `CONTACTMODEL_CACHE` names, else the platform's cache folder of the user."""
    chosen = os.environ.get("CONTACTMODEL_CACHE")
    return Path(chosen or user_cache_dir("contactmodel", appauthor=False))
