"""The one family of errors."""


class PsflutError(ValueError):
    """Something the caller can mend. The message is one sentence: expected, got, what to do."""
