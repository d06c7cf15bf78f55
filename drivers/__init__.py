"""Stages and sensors: small protocols, clocks and the drivers behind them.

A file or folder per device; `lines` is any sensor that prints its readings as text, `modbus` any
that keeps them in registers, `taxels` a tactile array, `lsl` a stream of the lab's network.
"""

from drivers.core.arrays import Array
from drivers.core.clocks import SimulatedClock, WallClock
from drivers.core.errors import ConfigError, DeviceAbsent, DeviceFault, MissingExtra, MotionFault
from drivers.core.protocols import Block, Channel, Clock, Pose, Sensor, Stage
from drivers.core.registry import available, find_driver, open_driver, settings_of
from drivers.core.settings import Settings

__all__ = [
    "Array",
    "Block",
    "Channel",
    "Clock",
    "ConfigError",
    "DeviceAbsent",
    "DeviceFault",
    "MissingExtra",
    "MotionFault",
    "Pose",
    "Sensor",
    "Settings",
    "SimulatedClock",
    "Stage",
    "WallClock",
    "available",
    "find_driver",
    "open_driver",
    "settings_of",
]
