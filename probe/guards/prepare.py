"""What a scan with these devices does: its plan, its limits, and what is stored of both."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from drivers import Clock, ConfigError, Pose, Sensor, SimulatedClock, Stage
from drivers.core import abilities
from drivers.core.stage_limits import outside
from probe.config.rig import Rig, RigError
from probe.config.snapshot import run_config
from probe.core.contact_stress import FORCE_ROLES, square_metres
from probe.guards.commands import Control
from probe.guards.device_facts import SensorFacts, StageFacts
from probe.guards.force_speed import slowed
from probe.guards.press_guard import ROUNDING, check_speed, press_speeds_m_s
from probe.guards.rehearsal import in_the_air, lift_m, needs_rehearsal
from probe.guards.safety_monitor import SafetyMonitor
from probe.planning.limits import Limits
from probe.planning.plan import Plan
from probe.planning.press_direction import pressed
from sim_backend.scene.scene_file import Scene

SETTLED = 5.0  # time constants, after which a step is off by 0.7 %
PULSE_HZ = 1.2  # of a resting adult, 72 a minute


class Opened(Protocol):
    """Open devices, or the facts of those that another process has opened."""

    @property
    def stage(self) -> Stage | StageFacts: ...
    @property
    def sensors(self) -> Sequence[Sensor | SensorFacts]: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


@dataclass(frozen=True)
class Prepared:
    """What a scan with these devices does, within which limits, and what it stores of both."""

    plan: Plan
    limits: Limits
    config: dict[str, Any]
    notes: tuple[str, ...]


def prepare(
    rig: Rig, plan: Plan, limits: Limits, scene: Scene | None, devices: Opened, seed: int
) -> Prepared:
    """The plan and limits as these devices allow them: in the air where nothing real feels.

    Raises `RigError` where newtons cannot become a stress, `ConfigError` where a rehearsal has no
    room, and where a move is too fast for the stage, or a press for its sensors. Whoever has the
    stage itself sees that it can make the moves.
    """
    here = None if isinstance(devices.stage, StageFacts) else devices.stage
    if here is not None:
        _check_contact(here, plan)
    notes, config = devices.notes, run_config(rig, scene, plan, seed)
    face_mm2 = config["face_mm2"]
    _check_face(face_mm2, devices.sensors)
    limits = replace(limits, face_m2=square_metres(face_mm2), filter_s=_filters(rig, devices))
    if filters_s := limits.filter_s.values():
        rest_s = SETTLED * max(filters_s)
        notes = (*notes, f"low pass of {max(filters_s):g} s (filter_s): the probe rests "
                 f"{max(rest_s, plan.settle_s):g} s in the air before each tare, and a pulse of "
                 f"{PULSE_HZ:g} Hz is read at {100 * _passed(max(filters_s)):.0f} %")  # fmt: skip
        plan = replace(plan, settle_s=max(plan.settle_s, rest_s))
    if needs_rehearsal(devices.stage, devices.sensors):
        up_mm = 1e3 * lift_m(plan)
        plan, limits = in_the_air(plan, limits)
        config |= {"rehearsal_mm": up_mm}
        notes = (*notes, f"REHEARSAL: no real sensor feels the force, so the real stage makes the "
                 f"whole scan in the air, {up_mm:g} mm higher than planned")  # fmt: skip
    plan, slower = slowed(plan, limits, devices.sensors)
    notes = (*notes, *slower)
    places = len({(place.x_m, place.y_m) for place in plan.places})
    if places * rig.scan.repeats < len(plan.places):
        where = f"{places} place{'s' * (places != 1)}"
        notes = (*notes, f"{len(plan.places)} stations lie at {where}: of a grid scan.pitch_mm is "
                 "[along x, along y]; scan.repeats presses a place again")  # fmt: skip
    if here is not None:
        _check_stage(here, plan)
        _check_reach(here, plan, limits)
    check_speed(plan, limits, devices.sensors)
    return Prepared(plan, limits, config, notes)


def monitor_for(
    stage: Stage,
    sensors: Sequence[Sensor],
    clock: Clock,
    plan: Plan,
    limits: Limits,
    control: Control,
    *,
    lifts_only: bool = False,
) -> SafetyMonitor:
    """The guards of a scan on these devices, in this process."""
    return SafetyMonitor(
        stage,
        sensors,
        clock,
        plan.surface,
        limits,
        control,
        threaded=not isinstance(clock, SimulatedClock),
        lift_z_m=plan.travel_z_m,
        lifts_only=lifts_only,
    )


def _filters(rig: Rig, devices: Opened) -> dict[str, float]:
    """The time constants of sensors that have a low pass, by name."""
    return {s.name: d.filter_s for d, s in zip(rig.sensor, devices.sensors, strict=False)
            if d.filter_s > 0}  # fmt: skip


def _passed(filter_s: float) -> float:
    """The share of a pulse that a low pass of first order leaves."""
    return 1 / math.hypot(1.0, 2 * math.pi * PULSE_HZ * filter_s)


def _check_contact(stage: Stage, plan: Plan) -> None:
    if plan.touch_n is None and abilities.finds_contact(stage):
        raise ConfigError(
            'stage.contact = "controller": the stage finds contact where the approach looks for '
            "it; say scan.touch_n too, or leave stage.contact out"
        )


def _check_stage(stage: Stage, plan: Plan) -> None:
    most_m_s = abilities.max_speed_m_s(stage)
    speeds_m_s = {"scan.travel_mm_s": plan.travel_m_s} | press_speeds_m_s(plan)
    for key, speed_m_s in speeds_m_s.items():
        if speed_m_s > most_m_s * (1 + ROUNDING):
            raise ConfigError(
                f"{key} = {1e3 * speed_m_s:g} mm/s: stage {stage.name!r} allows at most "
                f"{1e3 * most_m_s:g} mm/s (stage.max_speed_mm_s); scan slower, or allow it more"
            )


def _check_reach(stage: Stage, plan: Plan, limits: Limits) -> None:
    """The workspace is the rig's, and checked; here is what the stage itself refuses."""
    stations: dict[Pose, int] = {}
    for place in plan.places:
        above, deepest = plan.above(place), pressed(plan.at_surface(place), plan.deepest_m)
        for pose in (above, deepest, plan.away(above, limits.workspace_m[2][1])):
            stations.setdefault(pose, place.index + 1)
    for pose, why in abilities.beyond_limits(stage, list(stations)).items():
        raise ConfigError(
            f"stage.limits_mm: station {stations[pose]} needs {why}; change the scan, or allow "
            "more where the stage has room"
        )
    if (park := abilities.park(stage)) is None:
        return
    x, y, z = ((1e3 * low, 1e3 * high) for low, high in limits.workspace_m)
    for key, box in (("stage.limits_mm", abilities.limits_mm(stage)),
                     ("safety.workspace_mm", (x, y, z))):  # fmt: skip
        if (beyond := outside(box, park)) is not None:
            raise ConfigError(f"stage.park_mm: {beyond} ({key})")


def _check_face(face_mm2: float | None, sensors: Sequence[Sensor | SensorFacts]) -> None:
    """Newtons and pascals become each other, for detection and limits, over a known face only."""
    force_channels = [(s.name, c) for s in sensors for c in s.channels if c.role in FORCE_ROLES]
    if force_channels and face_mm2 is None:
        name, channel = force_channels[0]
        reads = "a force" if channel.role == "force" else "a pressure"
        raise RigError(
            f"face_mm2 is missing: sensor {name!r} reads {reads}, and without a simulated scene "
            "only you know the area of the probe's face that presses; say face_mm2 = 100 at the "
            "top of the rig file"
        )
