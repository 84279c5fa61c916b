from contactmodel.common.version import __version__ as __version__
