"""Opening a rig's devices: in the process that guards them, or here where time is simulated."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers import Sensor, SimulatedClock, Stage
from probe.config.devices import connect
from probe.guards.commands import Control
from probe.guards.guard_client import GuardClient
from probe.guards.guard_process import Order
from sim_backend.phantom.phantom import Respond
from sim_backend.scene.scene_file import Scene


@dataclass(frozen=True)
class OpenedRig:
    """What a scan runs on; ``monitor`` is in the other process, None if the engine makes one."""

    stage: Stage
    sensors: tuple[Sensor, ...]
    scene: Scene | None
    notes: tuple[str, ...]
    monitor: GuardClient | None


@contextmanager
def opened_devices(order: Order, respond: Respond | None, control: Control) -> Iterator[OpenedRig]:
    """Within: the devices of ``order``, closed at the end. Raises as `connect` does.

    On the wall clock they are in a process of their own. With a simulated clock there is nothing
    to be in time for; a ``respond`` of the caller's own answers in the caller's process only, and
    Windows gives no sockets to a child.
    """
    simulated = isinstance(order.clock, SimulatedClock) or respond is not None
    if not simulated and os.name == "posix":
        with GuardClient(order, control) as remote:
            yield OpenedRig(remote.stage, remote.sensors, remote.scene, remote.notes, remote)
        return
    with connect(
        order.rig, order.clock, order.scene, seed=order.seed, fallback=order.fallback,
        respond=respond,
    ) as devices:  # fmt: skip
        scene = devices.phantom.scene if devices.phantom is not None else None
        yield OpenedRig(devices.stage, devices.sensors, scene, devices.notes, None)
