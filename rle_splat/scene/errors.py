"""Exceptions that are shown to the user."""


class RleSplatError(Exception):
    """An error that the user can mend. The message says what is wrong and what to do; it is shown without traceback."""


class Cancelled(Exception):
    """The user stopped a long job. No partial result is left behind."""
