"""The errors of the package. Every text states the expectation, the finding and the remedy."""


class Error(Exception):
    """Any error of foveate's; wrong types are Python's own :class:`TypeError`."""


class InputError(Error, ValueError):
    """A value from the caller is invalid: a picture's shape, an empty box, a saved state of another version."""


class ConfigError(Error, ValueError):
    """A setting is misspelled, missing or out of range."""


class FileError(Error, OSError):
    """A file cannot be read, or has the wrong content."""
