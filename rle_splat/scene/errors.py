"""Exceptions that are shown to the user."""


class RleSplatError(Exception):
    """An error that the user can correct. The message says what is wrong and what to do; it is shown alone."""


class TooLargeError(RleSplatError):
    """The voxels of a volume need more memory than is free."""


class Cancelled(Exception):
    """The user stopped a long job. No partial result is left; if finished parts stay, the message says how to go on."""
