"""Errors of a calibration whose data do not determine a result."""


class CalibrationError(ValueError):
    """Data or a file that cannot be used; the text says why and what to add or change.

    Examples
    --------
    >>> import palpate
    >>> palpate.calibrate("mass", "weights.csv")
    Traceback (most recent call last):
    calibration.errors.CalibrationError: kind = 'mass': allowed are force, taxels, gravity, ...
    """
