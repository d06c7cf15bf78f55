"""What can be wrong with a run."""


class RunFileError(ValueError):
    """A run file that cannot be read: the text says which, what is wrong and what to do."""
