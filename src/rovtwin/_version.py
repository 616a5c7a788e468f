"""The version, where modules of the package can read it without the package's top."""

__version__ = "0.1.0"
