"""The one exception family."""


class AutowazeError(Exception):
    """Something a person can mend; the message says what, where, and what to do.

    The command line prints the message as one line and exits with 2.
    """


class TraceError(AutowazeError):
    """A drive cannot be read."""


class MapFileError(AutowazeError):
    """A stored feature map or parking map cannot be read."""


class WireError(AutowazeError):
    """A received message is not a valid semantic map diff."""


class ModelError(AutowazeError):
    """A segmentation model cannot be loaded or has an unknown layout."""


class DependencyError(AutowazeError):
    """An optional package or a system library is missing."""
