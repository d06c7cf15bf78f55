"""What a device layer can say went wrong."""


class ConfigError(ValueError):
    """A setting is wrong; nothing has moved. The text names key, value and what is allowed."""


class DeviceFault(RuntimeError):
    """A device stopped doing its job. ``device`` names it, ``reason`` says why in its own words."""

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
    """The device could not be reached at connection; the only fault a fallback may replace."""


class MissingExtra(ConfigError):
    """An optional library is not installed; the text holds the exact ``pip install`` line."""
