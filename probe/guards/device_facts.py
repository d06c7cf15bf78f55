"""What the engine knows of the devices that the guards have, wherever they are."""

from collections.abc import Sequence
from typing import NamedTuple

from drivers import Channel, Sensor, Stage
from drivers.core import abilities
from sim_backend.scene.scene_file import Scene


class StageFacts(NamedTuple):
    """What the engine must know of a stage that the guards move; see `drivers.core.abilities`."""

    name: str
    simulated: bool
    turns: bool
    homes: bool
    enable_s: float


class SensorFacts(NamedTuple):
    """And of a sensor that they read."""

    name: str
    channels: tuple[Channel, ...]
    rate_hz: float


class Facts(NamedTuple):
    """The devices that guards have; ``scene`` is what simulated ones feel."""

    stage: StageFacts
    sensors: tuple[SensorFacts, ...]
    notes: tuple[str, ...] = ()
    scene: Scene | None = None


def facts_of(stage: Stage, sensors: Sequence[Sensor]) -> Facts:
    """What can be said of open devices without asking them."""
    return Facts(
        StageFacts(
            stage.name,
            stage.simulated,
            abilities.turns(stage),
            abilities.homes(stage),
            abilities.enable_s(stage),
        ),
        tuple(SensorFacts(s.name, s.channels, s.rate_hz) for s in sensors),
    )
