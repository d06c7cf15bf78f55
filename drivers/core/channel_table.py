"""A channel as a rig file describes it, in whatever unit its device sends."""

from drivers.core.protocols import Channel, Role
from drivers.core.table import Table
from drivers.core.units import to_si


class ChannelTable(Table):
    """``scale`` x the device's number is in ``unit``, and stored in SI.

    ``full_scale`` is in ``unit`` too.
    """

    name: str
    unit: str
    role: Role = "other"
    scale: float = 1.0
    full_scale: float | None = None

    @property
    def si_per_number(self) -> float:
        """What the device's number is multiplied by."""
        return self.scale * to_si(self.unit)[1]

    def channel(self) -> Channel:
        """The channel as it is stored."""
        unit, factor = to_si(self.unit)
        full = None if self.full_scale is None else factor * self.full_scale
        return Channel(self.name, unit, self.role, full_scale=full)
