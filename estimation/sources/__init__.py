"""Readers: what sensors and archives write, as a `Recording`."""

from estimation.sources.archive import read_archive, write_archive
from estimation.sources.images import read_images
from estimation.sources.markers import ImageSettings
from estimation.sources.reading import find_recordings, read_recording
from estimation.sources.tac3d import read_tac3d

__all__ = [
    "ImageSettings",
    "find_recordings",
    "read_archive",
    "read_images",
    "read_recording",
    "read_tac3d",
    "write_archive",
]
