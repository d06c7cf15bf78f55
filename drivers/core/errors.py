"""What a device layer can say went wrong."""


class ConfigError(ValueError):
    """A setting is wrong; nothing has moved. The text names key, value and what is allowed.

    Examples
    --------
    >>> import palpate
    >>> palpate.scan(seed=-1)
    Traceback (most recent call last):
    drivers.core.errors.ConfigError: seed = -1: must not be negative
    """


class DeviceFault(RuntimeError):
    """A device stopped doing its job. ``device`` names it, ``reason`` says why in its own words.

    Examples
    --------
    >>> import palpate
    >>> fault = palpate.DeviceFault("ft300", "no reading for 0.5 s")
    >>> fault.device, str(fault)
    ('ft300', 'ft300: no reading for 0.5 s')
    """

    def __init__(self, device: str, reason: str) -> None:
        super().__init__(f"{device}: {reason}")
        self.device = device
        self.reason = reason

    def __reduce__(self) -> tuple[type["DeviceFault"], tuple[str, str]]:
        """As two words, so that it can pass from one process to another."""
        return type(self), (self.device, self.reason)


class MotionFault(DeviceFault):
    """A move did not end where it should, but the device answers: it can still be lifted."""


class DeviceAbsent(DeviceFault):
    """The device could not be reached at connection; the only fault a fallback may replace.

    Examples
    --------
    >>> import palpate
    >>> rig = palpate.Rig(stage={"driver": "grbl", "port": "/dev/ttyNone"})
    >>> palpate.connect(rig, palpate.WallClock())
    Traceback (most recent call last):
    drivers.core.errors.DeviceAbsent: grbl: port = '/dev/ttyNone': no such port; ...
    """


class MissingExtra(ConfigError):
    """An optional library is not installed; the text holds the exact ``pip install`` line."""


def as_fault(device: str, error: Exception) -> DeviceFault:
    """What a driver raised, as a fault of its device; a mistake of the driver's is called so."""
    if isinstance(error, DeviceFault):
        return error
    return DeviceFault(device, f"driver: {type(error).__name__}: {error}")
