"""Stages and sensors: small protocols, clocks and the drivers behind them.

A file or folder per device, each an entry point in pyproject.toml that `make install` reads;
`lines` is any sensor that prints its readings as text, `modbus` any that keeps them in registers,
`taxels` a tactile array, `lsl` a stream of the lab's network.

Names are imported when they are first used: what starts a process waits for no numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from drivers.core.arrays import Array
    from drivers.core.clocks import SimulatedClock, WallClock
    from drivers.core.errors import (
        ConfigError,
        DeviceAbsent,
        DeviceFault,
        MissingExtra,
        MotionFault,
    )
    from drivers.core.protocols import Block, Channel, Clock, Pose, Sensor, Stage
    from drivers.core.registry import available, find_driver, open_driver, settings_of
    from drivers.core.settings import Settings
else:
    _HOMES = {
        "arrays": ("Array",),
        "clocks": ("SimulatedClock", "WallClock"),
        "errors": ("ConfigError", "DeviceAbsent", "DeviceFault", "MissingExtra", "MotionFault"),
        "protocols": ("Block", "Channel", "Clock", "Pose", "Sensor", "Stage"),
        "registry": ("available", "find_driver", "open_driver", "settings_of"),
        "settings": ("Settings",),
    }

    def __getattr__(name):
        for home, names in _HOMES.items():
            if name in names:
                return getattr(import_module(f"drivers.core.{home}"), name)
        raise AttributeError(f"module 'drivers' has no attribute {name!r}")
