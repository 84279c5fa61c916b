"""The version of all four packages, which are one distribution."""

from importlib.metadata import version

__version__ = version("contactmodel")
