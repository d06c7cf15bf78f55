"""What can be wrong with a run."""


class RunFileError(ValueError):
    """A run file that cannot be read: the text says which, what is wrong and what to do.

    Examples
    --------
    >>> import palpate
    >>> palpate.open_run("lost.run")
    Traceback (most recent call last):
    probe.core.errors.RunFileError: lost.run: no such run file
    """


class StoreError(RuntimeError):
    """The run cannot be stored (any longer); what was committed before stays readable."""
