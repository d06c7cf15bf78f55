"""Opening a rig's devices: in the process that guards them, or here where time is simulated."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers import SimulatedClock
from probe.config.devices import connect
from probe.guards.commands import Control
from probe.guards.guard_client import GuardClient
from probe.guards.guard_process import Order
from probe.guards.interface import Guards
from probe.guards.prepare import Opened, Prepared, monitor_for
from sim_backend.scene.scene_file import Scene

if TYPE_CHECKING:  # a rig that only scans needs no phantom
    from sim_backend.phantom.phantom import Respond


@dataclass(frozen=True)
class OpenedRig:
    """What a scan runs on, and what makes its ``guards``; ``scene`` is what simulated devices feel.

    Of devices in the other process their facts are here.
    """

    devices: Opened
    scene: Scene | None
    guards: Callable[[Prepared], Guards]


@contextmanager
def opened_devices(
    order: Order, respond: "Respond | None", control: Control
) -> Iterator[OpenedRig]:
    """Within: the devices of ``order``, closed at the end. Raises as `connect` does.

    On the wall clock they are in a process of their own. With a simulated clock there is nothing
    to be in time for; a ``respond`` of the caller's own answers in the caller's process only, and
    Windows gives no sockets to a child.
    """
    simulated = isinstance(order.clock, SimulatedClock) or respond is not None
    if not simulated and os.name == "posix":
        with GuardClient(order, control) as remote:
            yield OpenedRig(remote.facts, remote.facts.scene, lambda _prepared: remote)
        return
    with connect(
        order.rig, order.clock, order.scene, seed=order.seed, fallback=order.fallback,
        respond=respond,
    ) as devices:  # fmt: skip
        scene = devices.phantom.scene if devices.phantom is not None else None
        yield OpenedRig(
            devices,
            scene,
            lambda prepared: monitor_for(
                devices.stage, devices.sensors, order.clock, prepared.plan, prepared.limits, control
            ),
        )
