"""The errors of the package. Every text states what was expected, what was found, and what to do."""


class Error(Exception):
    """Any error of foveate's; wrong types are Python's own :class:`TypeError`."""


class InputError(Error, ValueError):
    """A value given by the caller is not what it must be: a picture's shape, an empty box, a saved state of another version."""


class ConfigError(Error, ValueError):
    """A setting is misspelled, missing or out of range."""


class FileError(Error, OSError):
    """A file cannot be read, or is not what it should be."""
