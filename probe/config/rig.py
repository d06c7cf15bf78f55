"""A rig as data: which devices, what to press where, and what may never be exceeded.

Keys carry their units. `probe.config.load_rig` reads one from a file, `probe.config.scan_plan`
makes the plan and the limits of one.
"""

import math
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from drivers.core.table import Table
from probe.config.calibrated import kind_of
from probe.planning.plan import AWAY_M
from sim_backend.scene.explain import Explained
from sim_backend.scene.scene_file import Scene

MAX_PRESSES = 100_000
PITCH_MM = 4.0
MARGIN_MM = 4.0
"""The paper's stations: 4 mm apart, and the outer ones as far from the block's ends."""
Positive = Annotated[float, Field(gt=0)]
Pair = tuple[float, float]
Steps = Annotated[tuple[Positive, ...], Field(max_length=50)]
STEP_UP = 1.1
"""Of forces that are met to 5 %: they do not overlap."""
SHORTEST_STEP_S = 0.5
"""A shorter stop is not told from the rests in which a force is measured."""
FINEST_MM = 1e-6
"""A shorter press is none: a microstep of the finest screws is 10 nm."""
FARTHEST_MM = 10_000.0
"""No arm reaches so far."""
Place = Annotated[float, Field(ge=-FARTHEST_MM, le=FARTHEST_MM)]
Heights = (
    Place | Annotated[tuple[tuple[Place, Place, Place], ...], Field(min_length=3, max_length=500)]
)
Fallback = Literal["virtual"]
RASTER = "raster"
"""The planner that presses every station."""


READ_BY_CHECKS = ("rate_hz", "noise_mn")
"""Settings of sensors that are looked at before any driver has seen them."""
SLOWEST_FILTER_S = 10.0
"""Of a sensor; slower ones show no press."""
MOST_FORCE_SHARE = 0.8
"""Of the force limit, to be pressed to: 5 % may be overshot, and pulses of the paper's
arteries are 5 to 7 % of the force, with as much again for tissue that is held."""
LOUDEST_MN = 1e9
"""Noise that may be written down; 1e308 would overflow as a square."""


class RigError(ValueError):
    """A rig that cannot be: the text names file, key, value and what is allowed.

    Examples
    --------
    >>> import palpate
    >>> palpate.load_rig("lost.toml")
    Traceback (most recent call last):
    probe.config.rig.RigError: lost.toml: no such file
    """


class Device(Table):
    """A stage or sensor; every other key is a setting of its driver."""

    model_config = ConfigDict(extra="allow")
    driver: str
    """Which driver: `virtual`, one of the devices' pages, or your own."""
    fallback: Fallback | None = None
    """`virtual`: a simulated stand-in takes the place of an absent device, and is marked so."""
    filter_s: Annotated[float, Field(ge=0, le=SLOWEST_FILTER_S)] = 0.0
    """Of a sensor: the time constant of its own low pass, by which the force is ahead of what it
    reads; half the time that it averages. `palpate calibrate latency` finds it."""

    @property
    def settings(self) -> dict[str, Any]:
        """The driver's own keys."""
        return dict(self.model_extra or {})


class Scan(Table):
    """One row (numbers) or a grid (pairs of x and y) of presses."""

    start_mm: float | Pair = MARGIN_MM
    """Where the first station is: x, or [x, y] of a grid."""
    pitch_mm: float | Pair = PITCH_MM
    """From station to station: along x, or [along x, along y] of a grid."""
    stations: (
        Annotated[int, Field(ge=1, le=100_000)]
        | tuple[Annotated[int, Field(ge=1, le=1000)], Annotated[int, Field(ge=1, le=1000)]]
    ) = 15
    """How many, or [columns, rows] of a grid, which is scanned to and fro."""
    indentation_mm: Annotated[float, Field(ge=FINEST_MM, le=50)] = 2.5
    """How deep each press goes, from the surface along its normal."""
    force_n: Positive | None = None
    """Press until the force at rest is this, to 5 %, instead of to one depth: no deeper than
    `indentation_mm`, and so slowly that the press can be stopped at it on `hardest_n_mm`."""
    steps_mm: Steps = ()
    """Depths at which a press stops on its way, ascending; the last, at most `indentation_mm`, is
    held for `hold_s`, the others for `step_hold_s`."""
    steps_n: Steps = ()
    """The same in forces, each reached as `force_n` is."""
    step_hold_s: Annotated[float, Field(ge=SHORTEST_STEP_S, le=3600)] = 2.0
    """How long each step but the last is held; at least two heartbeats to find a pulse well."""
    ramp_s: Annotated[float, Field(gt=0, le=3600)] = 1.0
    """How long the press takes."""
    hold_s: Annotated[float, Field(ge=0, le=3600)] = 0.825
    """How long the probe stays pressed; at least two heartbeats to find a pulse well."""
    only: tuple[Annotated[int, Field(ge=1)], ...] = ()
    """Which of the stations are pressed, by their numbers from 1; by default all."""
    planner: Annotated[str, Field(min_length=1)] = RASTER
    """What chooses among the stations: `raster` presses all, others as many as they need."""
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1
    """Presses at each place, one after the other; each is a station of its own."""
    travel_mm_s: Positive = 20.0
    """Speed between stations, above the surface."""
    approach_mm_s: Positive = 10.0
    """Speed down to the surface."""
    settle_s: Annotated[float, Field(ge=0, le=60)] = 0.05
    """Rest in the air before each tare."""
    touch_n: Positive | None = None
    """Find the surface by touch: the approach goes on until the force reaches this. It must stand
    out of the sensor's noise; `scan --dry-run` says from where on it does."""
    search_mm: Positive = 2.0
    """With `touch_n`: how far below `surface_mm` to look; the workspace must allow it, and the
    press from there."""
    surface_mm: Heights = 0.0
    """Height of the surface: one number, or points [[x, y, z], ...] of it; three make a plane,
    more a smooth sheet."""

    @property
    def forces_n(self) -> tuple[float, ...]:
        """The forces that a press goes to, ascending; none if it goes to a depth."""
        return self.steps_n or (() if self.force_n is None else (self.force_n,))


class Workspace(Table):
    """The box the tip may be in, scan frame."""

    x: Pair = (-5.0, 70.0)
    """From, to."""
    y: Pair = (-5.0, 5.0)
    """From, to."""
    z: Pair = (-4.0, 50.0)
    """From, to; negative z is below the surface."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for axis, (low, high) in self:
            if low >= high:
                raise ValueError(f"{axis} = [{low:g}, {high:g}]: the first must be the smaller")
        return self


class Safety(Table):
    """What stops the scan."""

    max_force_n: Positive = 5.0
    """The scan lifts the probe when the force along the press, or the norm of all force
    components that are read, exceeds this."""
    max_torque_nm: Positive | None = None
    """The same for the norm of the torque, where a sensor reads it; by default `max_force_n` on a
    lever of 0.3 m, 1.5 Nm for 5 N."""
    max_depth_mm: Positive | None = None
    """Deepest the tip may be below the surface; by default 0.5 mm beyond the deepest press."""
    workspace_mm: Workspace = Workspace()
    """The box the tip may be in."""
    max_speed_mm_s: Positive = 25.0
    """No move is commanded faster. A stage that is seen to move more than 1.2 times as fast, and
    further than in 0.1 s at this speed, ends the scan."""
    retract_mm: Annotated[float, Field(ge=1e3 * AWAY_M)] = 2.0
    """How far above the highest station the probe travels, and lifts to. Before the first press it
    rises as far again, where the workspace has room, to see that it was in the air."""
    silence_s: Annotated[float, Field(ge=0.02, le=10)] = 0.25
    """A device that says nothing for longer stops the scan. A busy machine may need more."""
    late_s: Annotated[float, Field(ge=0.01, le=10)] = 0.2
    """While the stage moves, readings of force may be this old (at least five periods); less on
    the way down, as `hardest_n_mm` says."""
    hardest_n_mm: Annotated[float, Field(gt=0, le=10_000)] = 10.0
    """Stiffness of the hardest thing that may lie beneath the probe, in N per mm of depth. It says
    how old a force may be while the tip goes down: on this it could not have reached the limit."""
    contact_within_mm: Positive | None = None
    """A press that goes so far below the planned or touched surface and feels nothing ends the
    scan; by default half of the indentation. Asked of sensors whose noise is below a 500th of
    `max_force_n`."""
    engine_s: Annotated[float, Field(ge=0.1, le=60)] = 2.0
    """A scan that does nothing for longer is blocked: the probe is lifted without it."""
    same_readings: Annotated[int, Field(ge=20, le=1_000_000)] = 100
    """This many equal readings are those of a stuck sensor; say more for one whose noise is less
    than half of its step."""


class SceneChoice(Table):
    """What simulated parts feel."""

    name: str
    """A built-in scene, or a scene file beside the rig file."""
    surface_mm: Heights | None = None
    """Where its surface truly lies, as in `scan`; by default where the scan takes it to be."""


class Rig(Explained, Table):
    """A whole rig file. ``calibration`` maps kinds to files, as `probe.config.calibrated` says."""

    refusal: ClassVar = RigError
    stage: Device = Device(driver="virtual")
    """What moves the probe."""
    sensor: Annotated[tuple[Device, ...], Field(min_length=1)] = (Device(driver="virtual"),)
    """What feels, one table `[[sensor]]` each."""
    scan: Scan = Scan()
    """Where and how to press."""
    planner: dict[str, Any] = Field(default_factory=dict)
    """Settings of `scan.planner`."""
    safety: Safety = Safety()
    """What stops the scan."""
    scene: SceneChoice | None = None
    """What simulated devices feel."""
    calibration: dict[str, str] = Field(default_factory=dict)
    """Calibration files by kind, as `palpate calibrate` writes them:
    `force = "force-cell.json"`."""
    face_mm2: Positive | None = None
    """The probe's face: turns force into mean contact stress, and pressure into force for the
    limit. Known for simulated scenes."""

    @property
    def real(self) -> tuple[Device, ...]:
        """The devices that are not simulated by the phantom."""
        return tuple(one for one in (self.stage, *self.sensor) if one.driver != "virtual")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        scan, safety = self.scan, self.safety
        for key in self.calibration:
            kind_of(key)
        columns, rows = pair(scan.stations, 1)
        if (presses := columns * rows * scan.repeats) > MAX_PRESSES:
            raise ValueError(
                f"scan.stations and scan.repeats make {presses:g} presses; "
                f"at most {MAX_PRESSES} are allowed"
            )
        for n, device in enumerate(self.sensor):
            for key in READ_BY_CHECKS:
                value = device.settings.get(key, 1.0)
                if not isinstance(value, int | float):
                    text = f"sensor[{n}].{key} = {value!r}: must be a number"
                    raise ValueError(text)  # noqa: TRY004 - pydantic reports a ValueError
            if not 0 < (rate_hz := device.settings.get("rate_hz", 1.0)) < math.inf:
                raise ValueError(f"sensor[{n}].rate_hz = {rate_hz}: must be above 0")
            if not 0 <= (noise_mn := device.settings.get("noise_mn", 0.0)) <= LOUDEST_MN:
                raise ValueError(
                    f"sensor[{n}].noise_mn = {noise_mn:g}: must be from 0 to {LOUDEST_MN:g}"
                )
        speeds = {
            "scan.travel_mm_s": scan.travel_mm_s,
            "scan.approach_mm_s": scan.approach_mm_s,
            "scan.indentation_mm / scan.ramp_s": scan.indentation_mm / scan.ramp_s,
        }
        for key, speed in speeds.items():
            if speed > safety.max_speed_mm_s:
                limit = f"safety.max_speed_mm_s = {safety.max_speed_mm_s:g}"
                raise ValueError(f"{key} = {speed:g} mm/s: must not exceed {limit}")
        ends = {"force_n": scan.force_n, "steps_mm": scan.steps_mm, "steps_n": scan.steps_n}
        if len(given := [f"scan.{key}" for key, value in ends.items() if value]) > 1:
            raise ValueError(f"{given[1]}: a press ends by one of {', '.join(given)}; leave one")
        for key, steps in (("steps_mm", scan.steps_mm), ("steps_n", scan.steps_n)):
            if list(steps) != sorted(set(steps)):
                raise ValueError(f"scan.{key} = {list(steps)}: must ascend")
        if any(b < STEP_UP * a for a, b in pairwise(scan.steps_n)):
            each = f"each must be {STEP_UP:g} times the one before at least: a force is met to 5 %"
            raise ValueError(f"scan.steps_n = {list(scan.steps_n)}: {each}")
        if scan.steps_mm and scan.steps_mm[-1] > scan.indentation_mm:
            deepest = f"scan.indentation_mm = {scan.indentation_mm:g}"
            raise ValueError(
                f"scan.steps_mm = {list(scan.steps_mm)}: must end at most at {deepest}"
            )
        most_n, force_n = MOST_FORCE_SHARE * safety.max_force_n, max(scan.forces_n, default=0.0)
        if force_n > most_n:
            key = "steps_n" if scan.steps_n else "force_n"
            raise ValueError(
                f"scan.{key} = {force_n:g}: must be at most {most_n:g}, "
                f"{MOST_FORCE_SHARE:g} of safety.max_force_n = {safety.max_force_n:g}: a pulse and "
                "what a press overshoots by need the rest"
            )
        if scan.touch_n is not None and scan.touch_n >= safety.max_force_n:
            limit = f"safety.max_force_n = {safety.max_force_n:g}"
            raise ValueError(f"scan.touch_n = {scan.touch_n:g}: must be below {limit}")
        return self


def default_rig(scene: Scene | None = None) -> Rig:
    """The simulated rig: a row of stations 4 mm apart over the whole block.

    Parameters
    ----------
    scene
        What is to be pressed: the row is in the middle of its block and stays 4 mm or more
        from the ends, a lone vessel has one station over its middle. Without it there are
        15 stations.

    Returns
    -------
    Rig
        With a virtual stage and a virtual force sensor.

    Examples
    --------
    >>> import palpate
    >>> palpate.default_rig().scan.stations
    15
    >>> palpate.default_rig(palpate.load_scene("HAOT")).scan.stations
    1
    """
    if scene is None:
        return Rig()
    if scene.tissue is None:
        return Rig(scan=Scan(start_mm=scene.inclusion[0].x_mm, stations=1))
    width_mm = scene.tissue.width_mm
    stations = max(1, int((width_mm - 2 * MARGIN_MM) // PITCH_MM) + 1)
    start_mm = (width_mm - PITCH_MM * (stations - 1)) / 2
    box = Workspace()
    box = box.model_copy(update={"x": (box.x[0], max(box.x[1], width_mm))})
    return Rig(scan=Scan(start_mm=start_mm, stations=stations), safety=Safety(workspace_mm=box))


def pair(value: float | Pair, second: float) -> Pair:
    """A key of `Scan` along x and y; one number is a row's."""
    return value if isinstance(value, tuple) else (value, second)
