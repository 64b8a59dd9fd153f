"""The root of all errors of this package."""


class MbpamError(Exception):
    """Something that this package names and explains: what is wrong, where, and what to do.

    Each error is also one of Python's own kinds (ValueError, RuntimeError, ImportError), for callers that know only
    those.
    """
