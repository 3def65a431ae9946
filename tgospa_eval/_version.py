"""Version of the package, in a module that imports nothing, so that any other can import it."""

__version__ = "0.2.0"
