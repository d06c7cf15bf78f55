"""What moves and what feels: small protocols, clocks and the drivers behind them."""

from drivers.clocks import SimulatedClock, WallClock
from drivers.errors import ConfigError, DeviceAbsent, DeviceFault, MissingExtra
from drivers.protocols import Array, Block, Channel, Clock, Pose, Sensor, Stage
from drivers.registry import available, find_driver

__all__ = [
    "Array",
    "Block",
    "Channel",
    "Clock",
    "ConfigError",
    "DeviceAbsent",
    "DeviceFault",
    "MissingExtra",
    "Pose",
    "Sensor",
    "SimulatedClock",
    "Stage",
    "WallClock",
    "available",
    "find_driver",
]
