"""From a rig to open devices; a simulated stand-in only where the rig or the user says so."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pydantic import ValidationError

from drivers import (
    Clock,
    ConfigError,
    DeviceAbsent,
    DeviceFault,
    Sensor,
    SimulatedClock,
    Stage,
    open_driver,
)
from drivers.core.errors import as_fault
from drivers.core.protocols import ROLES, UNIT_OF_ROLE
from drivers.core.registry import Kind, settings_of
from probe.config.calibrated import calibrated
from probe.config.rig import Device, Fallback, Rig, RigError
from probe.config.scan_plan import beside_the_block, plan_for, true_surface
from probe.planning.plan import Plan
from sim_backend.scene.explain import explain
from sim_backend.scene.scene_file import Scene, load_scene, scene_names

if TYPE_CHECKING:  # a rig that only scans needs no phantom
    from sim_backend.phantom.phantom import Phantom, Respond

VIRTUAL = Device(driver="virtual")
MADE: dict[Kind, type] = {"stages": Stage, "sensors": Sensor}


@dataclass(frozen=True)
class Devices:
    """What a scan runs on; ``notes`` name every stand-in. Leaving the context closes all."""

    stage: Stage
    sensors: tuple[Sensor, ...]
    phantom: "Phantom | None"
    notes: tuple[str, ...]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.stage.close()
        for sensor in self.sensors:
            sensor.close()
        if self.phantom is not None:
            self.phantom.close()


def connect(
    rig: Rig,
    clock: Clock,
    scene: Scene | None = None,
    *,
    seed: int = 0,
    fallback: Fallback | None = None,
    respond: "Respond | None" = None,
) -> Devices:
    """Open every device of the rig.

    Parameters
    ----------
    rig
        Which devices, and their settings.
    clock
        What times are taken on. With the wall clock every station of a simulated rig is
        solved here, so that no reading waits for the physics.
    scene
        What simulated devices feel, in place of the rig's own.
    seed
        Of the simulated noise: the same seed gives the same readings.
    fallback
        ``virtual`` allows a simulated stand-in for every absent device.
    respond
        What answers for the tissue at a place (scene, x in mm, deepest press in mm); by
        default the finite elements.

    Returns
    -------
    Devices
        The stage and the sensors, open.

    Raises
    ------
    RigError, SceneError
        The rig or the scene cannot be.
    DeviceAbsent
        Devices are not there and no stand-in is allowed; all of them are named.
    DeviceFault
        A driver's own mistake.

    Examples
    --------
    >>> import palpate
    >>> scene = palpate.load_scene("TIHA")
    >>> with palpate.connect(palpate.default_rig(), palpate.SimulatedClock(), scene) as devices:
    ...     [(channel.name, channel.unit) for channel in devices.sensors[0].channels]
    [('force', 'N'), ('von_mises', 'Pa')]
    """
    plan = plan_for(rig)
    world = World(rig, plan, clock, scene, seed, respond)
    with ExitStack() as undo:
        undo.enter_context(closing(world))
        opening = Opening(world, fallback, undo)
        stage: Stage = opening.device("stages", "stage", rig.stage, {})
        # None where it is missing: then `sensors` names it and raises
        follow = {} if stage is None or stage.name == "virtual" else {"follow": stage}
        sensors = opening.sensors({"seed": seed, **follow})
        stage, true, remarks = calibrated(
            stage, sensors, rig.calibration, stand_ins=opening.stand_ins
        )
        check_units(true)
        if world.phantom is not None:
            # a real stage that nothing real feels for makes its scan in the air
            if stage.simulated and (why := beside_the_block(plan, world.phantom.scene)) is not None:
                raise RigError(why)
            if respond is None:
                world.phantom.solve_ahead([(p.x_m, p.y_m) for p in plan.places if plan.upright(p)])
            if not isinstance(clock, SimulatedClock):
                world.phantom.prepare([(p.x_m, p.y_m) for p in plan.places])
        undo.pop_all()
    return Devices(stage, true, world.phantom, (*opening.notes, *remarks))


@contextmanager
def open_sensors(
    rig: Rig, clock: Clock, scene: Scene | None = None, *, fallback: Fallback | None = None
) -> Iterator[tuple[Sensor, ...]]:
    """Only the rig's sensors, as the devices give them: no stage, no calibration.

    Simulated ones hang in the air. Raises as `connect` does.
    """
    with closing(World(rig, plan_for(rig), clock, scene)) as world, ExitStack() as opened:
        yield tuple(Opening(world, fallback, opened).sensors({"seed": 0}))


@dataclass
class World:
    """The one phantom, made when the first simulated device asks for it."""

    rig: Rig
    plan: Plan
    clock: Clock
    scene: Scene | None = None
    seed: int = 0
    respond: "Respond | None" = None
    phantom: "Phantom | None" = None

    def close(self) -> None:
        if self.phantom is not None:
            self.phantom.close()

    def get(self) -> "Phantom":
        if self.phantom is not None:
            return self.phantom
        rig, folder = self.rig, Path()
        if self.scene is None:
            if rig.scene is None:
                if rig.real and "stage" not in rig.model_fields_set:
                    raise RigError("[stage] is missing: say what moves the probe")
                raise RigError(
                    "scene.name is missing: a simulated device needs a scene; "
                    f"built in: {', '.join(scene_names())}"
                )
            self.scene, folder = load_scene(rig.scene.name), Path(rig.scene.name).parent
        if rig.scan.indentation_mm >= self.scene.surface_mm:
            raise RigError(
                f"scan.indentation_mm = {rig.scan.indentation_mm:g}: scene {self.scene.name} is "
                f"only {self.scene.surface_mm:g} mm thick"
            )
        from sim_backend.models.station_response import respond as by_finite_elements
        from sim_backend.phantom.phantom import Phantom

        plan = self.plan
        first = plan.places[0]
        self.phantom = Phantom(
            self.scene,
            self.clock,
            self.respond or by_finite_elements,
            seed=self.seed,
            surface=true_surface(rig) or plan.surface,
            home=(first.x_m, first.y_m, plan.travel_z_m),
            depth_m=plan.indentation_m,
            folder=folder,
        )
        return self.phantom


@dataclass
class Opening:
    """The devices of a rig, opened one after the other and closed with ``opened``: ``notes`` of
    what stands in for the ``stand_ins``, and the ``missing``, for which nothing may."""

    world: World
    fallback: Fallback | None
    opened: ExitStack
    notes: list[str] = field(default_factory=list)
    stand_ins: list[str] = field(default_factory=list)
    missing: list[DeviceAbsent] = field(default_factory=list)

    def device(self, kind: Kind, where: str, device: Device, extra: dict[str, Any]) -> Any:
        """One device, connected, or its stand-in; None where it is missing."""
        if self.missing and device.driver == "virtual":
            return None  # it is never missing, and may want a scene that a real rig has not
        made = make_device(kind, where, device, self.world, extra)
        try:
            _connect(made)
        except DeviceAbsent as absent:
            if (device.fallback or self.fallback) is None:
                self.missing.append(absent)
                return None
            self.notes.append(f"{where}: {absent}; a simulated stand-in takes its place")
            self.stand_ins.append(made.name)
            if kind == "sensors":  # under its own name, so that several may be absent
                extra = {**extra, "name": made.name}
            made = make_device(kind, where, VIRTUAL, self.world, extra)
            made.connect()
        self.opened.enter_context(closing(made))
        return made

    def sensors(self, extra: dict[str, Any]) -> list[Sensor]:
        """All of them, the last to be opened. Raises `DeviceAbsent`, which names every missing
        device, and `RigError` where two sensors have one name."""
        sensors = [
            self.device("sensors", f"sensor[{n}]", device, extra)
            for n, device in enumerate(self.world.rig.sensor)
        ]
        if self.missing:
            first, *others = self.missing
            raise DeviceAbsent(first.device, "; also ".join([first.reason, *map(str, others)]))
        check_names(sensors)
        return sensors


def _connect(made: Stage | Sensor) -> None:
    """Raises `DeviceFault` also for a mistake of the driver's."""
    try:
        made.connect()
    except ConfigError:
        raise
    except Exception as error:  # drivers of others may raise anything
        raise as_fault(made.name, error) from error


def make_device(kind: Kind, where: str, device: Device, world: World, extra: dict[str, Any]) -> Any:
    """One device by its driver, not connected; ``where`` names its table.

    Raises `RigError`, and `DeviceFault` for a driver's own mistake.
    """
    settings = device.settings
    name = str(settings.get("name", device.driver))
    try:
        if device.driver == "virtual":
            settings = {**extra, **settings, "phantom": world.get()}
        made = open_driver(kind, device.driver, world.clock, settings)
    except ValidationError as error:
        raise RigError(
            "\n".join(
                f"{where}.{line}" for line in explain(error, settings_of(kind, device.driver))
            )
        ) from None
    except ConfigError as error:
        raise RigError(f"{where}.{error}") from None
    except Exception as error:  # drivers of others may raise anything
        if device.driver == "virtual":
            raise
        raise as_fault(name, error) from error
    wanted = MADE[kind]
    if not isinstance(made, wanted):
        raise DeviceFault(
            name, f"driver: its factory returned {made!r:.60}, and not a {wanted.__name__}: one "
            f"has all that drivers.{wanted.__name__} names"
        )  # fmt: skip
    for channel in getattr(made, "channels", ()):  # a stage has none
        if channel.role not in ROLES:
            raise DeviceFault(
                name, f"driver: channel {channel.name!r} has the role {channel.role!r}; allowed: "
                f"{', '.join(ROLES)}"
            )  # fmt: skip
    return made


def check_units(sensors: Sequence[Sensor]) -> None:
    """Raises `RigError` where the force limit would take another unit for newtons or pascals."""
    for sensor in sensors:
        for channel in sensor.channels:
            if channel.unit != (unit := UNIT_OF_ROLE.get(channel.role, channel.unit)):
                raise RigError(
                    f"sensor {sensor.name!r}, channel {channel.name}: is in {channel.unit!r}; "
                    f"what a driver or its calibration gives as {channel.role} must be in {unit}"
                )


def check_names(sensors: Sequence[Sensor]) -> None:
    """Raises `RigError` where two sensors have one name."""
    names = [sensor.name for sensor in sensors]
    for n, name in enumerate(names):
        if name in names[:n] or name == "stage":
            raise RigError(f"sensor[{n}].name = {name!r}: taken; give each sensor its own name")
