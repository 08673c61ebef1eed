"""What a user is told when something cannot be done."""


class RleSplatError(Exception):
    """One sentence for the user: what is wrong and what to do.  Shown as it is, never as a traceback."""


class Cancelled(Exception):
    """The user stopped a long job; nothing half-made is left behind."""
