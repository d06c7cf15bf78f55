"""The rig file: which devices, what to press where, and what may never be exceeded.

Keys carry their units. Everything is checked before a device is opened; a fault is named with
file, key, value and what is allowed.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from scipy.interpolate import RBFInterpolator

from probe.calibrated import give_of, kind_of, surface_of
from probe.guards import Limits
from probe.plan import Plan, Surface, check_reach, grid, repeated
from sim_backend.scene import MAX_FILE_BYTES, Scene, explain, scene_names

MAX_PRESSES = 100_000
Positive = Annotated[float, Field(gt=0)]
Pair = tuple[float, float]
Heights = (
    float | Annotated[tuple[tuple[float, float, float], ...], Field(min_length=3, max_length=500)]
)
Fallback = Literal["virtual"]


class RigError(ValueError):
    """A rig that cannot be: the text names file, key, value and what is allowed."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Device(_Table):
    """A stage or sensor; every key but these two is a setting of its driver."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)
    driver: str
    fallback: Fallback | None = None

    @property
    def settings(self) -> dict[str, Any]:
        """The driver's own keys."""
        return dict(self.model_extra or {})


class Scan(_Table):
    """One row (numbers) or a grid (pairs of x and y) of presses.

    ``surface_mm`` is the surface's height: one number, or points [x, y, z] of it (three make a
    plane, more a smooth sheet). With ``touch_n`` the surface is found by touch within
    ``search_mm``. ``repeats`` presses each place several times in a row.
    """

    start_mm: float | Pair = 4.0
    pitch_mm: float | Pair = 4.0
    stations: (
        Annotated[int, Field(ge=1, le=100_000)]
        | tuple[Annotated[int, Field(ge=1, le=1000)], Annotated[int, Field(ge=1, le=1000)]]
    ) = 15
    indentation_mm: Annotated[float, Field(gt=0, le=50)] = 2.5
    ramp_s: Annotated[float, Field(gt=0, le=3600)] = 1.0
    hold_s: Annotated[float, Field(ge=0, le=3600)] = 0.825
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1
    travel_mm_s: Positive = 20.0
    approach_mm_s: Positive = 10.0
    settle_s: Annotated[float, Field(ge=0, le=60)] = 0.05
    touch_n: Positive | None = None
    search_mm: Positive = 2.0
    surface_mm: Heights = 0.0


class Workspace(_Table):
    """The box the tip may be in, scan frame."""

    x: Pair = (-5.0, 70.0)
    y: Pair = (-5.0, 5.0)
    z: Pair = (-4.0, 50.0)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for axis, (low, high) in self:
            if low >= high:
                raise ValueError(f"{axis} = [{low:g}, {high:g}]: the first must be the smaller")
        return self


class Safety(_Table):
    """What stops the scan; ``max_depth_mm`` is by default 0.5 mm beyond the deepest press."""

    max_force_n: Positive = 5.0
    max_depth_mm: Positive | None = None
    workspace_mm: Workspace = Workspace()
    max_speed_mm_s: Positive = 25.0
    retract_mm: Positive = 2.0
    silence_s: Annotated[float, Field(ge=0.02, le=10)] = 0.25


class SceneChoice(_Table):
    """What simulated parts feel: a built-in scene's name or a scene file.

    ``surface_mm``: where it truly lies, as in `Scan`; by default where the scan takes it to be.
    """

    name: str
    surface_mm: Heights | None = None

    @property
    def surface(self) -> Surface | None:
        """The true height [m] over x, y [m], if it was given."""
        return None if self.surface_mm is None else _surface(self.surface_mm)


class Rig(_Table):
    """A whole rig file. ``calibration`` maps kinds to files, as `probe.calibrated` says."""

    stage: Device = Device(driver="virtual")
    sensor: Annotated[tuple[Device, ...], Field(min_length=1)] = (Device(driver="virtual"),)
    scan: Scan = Scan()
    safety: Safety = Safety()
    scene: SceneChoice | None = None
    calibration: dict[str, str] = Field(default_factory=dict)
    face_mm2: Positive | None = None

    @property
    def plan(self) -> Plan:
        """The scan as stations and one press, SI."""
        scan = self.scan
        (x, dx, columns), (y, dy, rows) = zip(
            _pair(scan.start_mm, 0.0),
            _pair(scan.pitch_mm, 0.0),
            _pair(scan.stations, 1),
            strict=True,
        )
        give = give_of(self.calibration["compliance"]) if "compliance" in self.calibration else 0.0
        places = grid((1e-3 * x, 1e-3 * y), (1e-3 * dx, 1e-3 * dy), (int(columns), int(rows)))
        return Plan(
            places=repeated(places, scan.repeats),
            indentation_m=1e-3 * scan.indentation_mm,
            ramp_s=scan.ramp_s,
            hold_s=scan.hold_s,
            clearance_m=1e-3 * self.safety.retract_mm,
            travel_m_s=1e-3 * scan.travel_mm_s,
            approach_m_s=1e-3 * scan.approach_mm_s,
            settle_s=scan.settle_s,
            touch_n=scan.touch_n,
            search_m=1e-3 * scan.search_mm,
            surface=(
                surface_of(self.calibration["surface"])
                if "surface" in self.calibration
                else _surface(scan.surface_mm)
            ),
            give_m_n=give,
            give_m=give * self.safety.max_force_n,
        )

    @property
    def limits(self) -> Limits:
        """The safety table, SI."""
        safety, plan = self.safety, self.plan
        deepest_mm = safety.max_depth_mm or 1e3 * plan.deepest_below_m + 0.5
        box = safety.workspace_mm
        x, y, z = (((1e-3 * low), (1e-3 * high)) for low, high in (box.x, box.y, box.z))
        return Limits(
            max_force_n=safety.max_force_n,
            max_depth_m=1e-3 * deepest_mm,
            workspace_m=(x, y, z),
            max_speed_m_s=1e-3 * safety.max_speed_mm_s,
            silence_s=safety.silence_s,
            face_m2=None if self.face_mm2 is None else 1e-6 * self.face_mm2,
        )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        scan, safety = self.scan, self.safety
        for key in self.calibration:
            kind_of(key)
        columns, rows = _pair(scan.stations, 1)
        if (presses := columns * rows * scan.repeats) > MAX_PRESSES:
            raise ValueError(
                f"scan.stations and scan.repeats make {presses:g} presses; "
                f"at most {MAX_PRESSES} are allowed"
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
        if scan.touch_n is not None and scan.touch_n >= safety.max_force_n:
            limit = f"safety.max_force_n = {safety.max_force_n:g}"
            raise ValueError(f"scan.touch_n = {scan.touch_n:g}: must be below {limit}")
        deepest_mm = 1e3 * self.plan.deepest_below_m
        if safety.max_depth_mm is not None and safety.max_depth_mm < deepest_mm:
            raise ValueError(
                f"safety.max_depth_mm = {safety.max_depth_mm:g}: the scan goes {deepest_mm:g} mm "
                "deep; allow that or press less"
            )
        check_reach(self.plan, self.limits.workspace_m)
        return self


def load_rig(path: str | Path) -> Rig:
    """Read a rig file; the paths in it are relative to its folder. Raises `RigError`."""
    path = Path(path)
    if not path.is_file():
        raise RigError(f"{path}: no such file")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise RigError(f"{path}: larger than {MAX_FILE_BYTES} bytes; not a rig file")
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        _find_calibrations(raw, path)
        rig = Rig.model_validate(raw)
    except UnicodeDecodeError as error:
        raise RigError(f"{path}: not UTF-8 text ({error.reason})") from None
    except tomllib.TOMLDecodeError as error:
        raise RigError(f"{path}: not TOML: {error}") from None
    except ValidationError as error:
        raise RigError("\n".join(f"{path}: {line}" for line in explain(error))) from None
    update: dict[str, Any] = {}
    if rig.scene is not None and rig.scene.name not in scene_names():
        name = str(path.parent / rig.scene.name)
        update["scene"] = rig.scene.model_copy(update={"name": name})
    return rig.model_copy(update=update)


def _find_calibrations(raw: dict[str, Any], path: Path) -> None:
    """Make the paths of calibrations relative to the rig file's folder, in place."""
    files = raw.get("calibration")
    if not isinstance(files, dict):
        return  # validation says what is wrong
    for kind, name in files.items():
        if isinstance(name, str):
            file = path.parent / name
            if not file.is_file():
                raise RigError(f"{path}: calibration.{kind} = {str(file)!r}: no such file")
            files[kind] = str(file)


def default_rig(scene: Scene | None = None) -> Rig:
    """The simulated rig: 15 stations 4 mm apart, or the one over an artery out of tissue."""
    if scene is None or scene.tissue is not None:
        return Rig()
    return Rig(scan=Scan(start_mm=scene.inclusion[0].x_mm, stations=1))


def _pair(value: float | tuple[float, float], second: float) -> tuple[float, float]:
    return value if isinstance(value, tuple) else (value, second)


def _surface(height_mm: Heights) -> Surface:
    """A level, or the thin-plate spline through measured points (a plane through three)."""
    if not isinstance(height_mm, tuple):
        level = 1e-3 * height_mm
        return lambda _x, _y: level
    points = 1e-3 * np.array(height_mm)
    if len(points) == 3:
        return _plane(points)
    try:
        sheet = RBFInterpolator(points[:, :2], points[:, 2], kernel="thin_plate_spline", degree=1)
    except np.linalg.LinAlgError:
        raise ValueError("surface_mm: the points must not lie on one line") from None
    return lambda x, y: float(sheet(np.array([[x, y]]))[0])


def _plane(points: NDArray[np.float64]) -> Surface:
    """The plane through three points (3, 3) [m]."""
    (x0, y0, z0), to_second, to_third = points[0], points[1] - points[0], points[2] - points[0]
    east, north, up = np.cross(to_second, to_third).tolist()
    if abs(up) <= 1e-9 * np.linalg.norm(to_second) * np.linalg.norm(to_third):
        raise ValueError("surface_mm: the points must not lie on one line")
    return lambda x, y: float(z0 - (east * (x - x0) + north * (y - y0)) / up)
