"""A scan from a rig to a run file: the one call behind ``palpate scan`` and notebooks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers import Clock, ConfigError, Sensor, SimulatedClock, WallClock
from probe.control import Control
from probe.describe import run_config
from probe.devices import connect
from probe.engine import run_scan
from probe.events import RunEnded
from probe.live.remote import listening
from probe.rig import Fallback, Rig, RigError, SceneChoice, default_rig, load_rig
from probe.store import create_store
from probe.tell import Emit
from sim_backend.phantom import Respond
from sim_backend.scene import Scene, load_scene

DEFAULT_SCENE = "TIHA"


@dataclass(frozen=True)
class Scanned:
    """Where the run is stored, its last event, and what a person should know of the devices."""

    path: Path
    ended: RunEnded
    notes: tuple[str, ...]


def scan(
    rig: Rig | str | Path | None = None,
    scene: str | Path | None = None,
    out: str | Path = "runs",
    *,
    seed: int = 0,
    fallback: Fallback | None = None,
    real_time: bool = False,
    control: Control | None = None,
    observers: Sequence[Emit] = (),
    opened: Callable[[Path, tuple[str, ...]], None] = lambda _path, _notes: None,
    respond: Respond | None = None,
) -> Scanned:
    """Scan with a rig (by default the simulated one) and store the run in a new file in ``out``.

    ``scene``, a built-in name or a file, is what simulated devices feel. A rig of simulated
    devices only runs on simulated time, as fast as the machine allows, unless ``real_time``.
    ``opened`` is told the run file and the devices' notes before anything moves.
    Raises `RigError`, `SceneError`, `drivers.ConfigError` and `drivers.DeviceFault` before
    anything moves, and `sim_backend.press.CannotSolve`; any later fault is in ``ended``.
    """
    if seed < 0:
        raise ConfigError(f"seed = {seed}: must not be negative")
    rig, _ = chosen(rig, scene)
    clock = clock_for(rig, real_time=real_time)
    control = control or Control()
    with connect(rig, clock, seed=seed, fallback=fallback, respond=respond) as devices:
        felt = devices.phantom.scene if devices.phantom is not None else None
        config = run_config(rig, felt, rig.plan, seed)
        _check_face(config, devices.sensors)
        path = new_run_path(Path(out), felt.name if felt is not None else devices.stage.name)
        with create_store(path) as sink, listening(control, path):
            opened(path, devices.notes)
            ended = run_scan(
                rig.plan,
                devices.stage,
                devices.sensors,
                clock,
                sink,
                rig.limits,
                control=control,
                observers=observers,
                config=config,
            )
    return Scanned(path, ended, devices.notes)


def chosen(rig: Rig | str | Path | None, scene: str | Path | None) -> tuple[Rig, Scene | None]:
    """The rig with the scene its simulated devices shall feel, and that scene.

    Without a rig the simulated one, over `DEFAULT_SCENE` if no scene is given either.
    """
    if rig is None:
        name = str(scene or DEFAULT_SCENE)
        felt = load_scene(name)
        return default_rig(felt).model_copy(update={"scene": SceneChoice(name=name)}), felt
    if not isinstance(rig, Rig):
        rig = load_rig(rig)
    if scene is not None:
        lies = None if rig.scene is None else rig.scene.surface_mm
        choice = SceneChoice(name=str(scene), surface_mm=lies)
        rig = rig.model_copy(update={"scene": choice})
    return rig, None if rig.scene is None else load_scene(rig.scene.name)


def _check_face(config: Mapping[str, Any], sensors: Sequence[Sensor]) -> None:
    """Newtons become a stress, which detection works on, only over a known face."""
    forces = [s.name for s in sensors if any(c.role == "force" for c in s.channels)]
    if forces and config["face_mm2"] is None:
        raise RigError(
            f"face_mm2 is missing: sensor {forces[0]!r} reads a force, and without a simulated "
            "scene only you know the area of the probe's face that presses; say face_mm2 = 100"
        )


def clock_for(rig: Rig, *, real_time: bool) -> Clock:
    """Simulated time if every device is simulated and nobody wants to wait."""
    simulated = all(device.driver == "virtual" for device in (rig.stage, *rig.sensor))
    return SimulatedClock() if simulated and not real_time else WallClock()


def new_run_path(folder: Path, name: str) -> Path:
    """A file in ``folder`` that does not exist yet; the folder is made."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    number = 1
    while (path := folder / (f"{stem}.run" if number == 1 else f"{stem}-{number}.run")).exists():
        number += 1
    return path
