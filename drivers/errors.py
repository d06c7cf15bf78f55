"""What a device layer can say went wrong."""


class ConfigError(ValueError):
    """A setting is wrong; nothing has moved. The text names key, value and what is allowed."""


class DeviceFault(RuntimeError):
    """A device stopped doing its job. ``device`` names it, ``reason`` says why in its own words."""

    def __init__(self, device: str, reason: str) -> None:
        super().__init__(f"{device}: {reason}")
        self.device = device
        self.reason = reason


class DeviceAbsent(DeviceFault):
    """The device could not be reached at connection; the only fault a fallback may replace."""


class MissingExtra(ConfigError):
    """A driver's library is not installed; the text holds the exact ``pip install`` line."""
