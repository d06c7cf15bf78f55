"""Calibrations applied to a rig: true forces at true times, true places, and its compliance.

A rig file names the files: ``[calibration] force = "force-ft300.json"``. Where two devices have
one of a kind, a word is added: ``latency_ppg``. A file of another device is refused, an old one
used with a note; what was applied is in every run.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration import (
    AxesCalibration,
    ComplianceCalibration,
    ForceCalibration,
    LatencyCalibration,
    Record,
    SurfaceCalibration,
    TaxelCalibration,
    load,
    restore,
    use,
)
from calibration.errors import CalibrationError
from drivers import Block, Channel, Pose, Sensor, Stage
from drivers.core import abilities
from drivers.core.arrays import Array
from probe.planning.surfaces import Surface

SENSOR_KINDS = ("force", "taxels", "latency")
STAGE_KINDS = ("surface", "compliance", "axes")
KINDS = (*SENSOR_KINDS, *STAGE_KINDS)
CLIPPED = 0.98  # of a taxel's span: from here on its reading is a bound


class CalibratedSensor:
    """A sensor whose values and times are put right; all else is the device's own.

    The device's tare is the offset, so only gains act. A dead taxel is no taxel any more: its
    channel is kept, but nothing takes it for a stress.
    """

    def __init__(
        self,
        sensor: Sensor,
        force: ForceCalibration | None = None,
        latency: LatencyCalibration | None = None,
        taxels: TaxelCalibration | None = None,
    ) -> None:
        self._sensor = sensor
        self._latency = latency
        self._taxels = taxels
        self.channels = sensor.channels
        self._gains: list[tuple[list[int], Array]] = []
        if force is not None:
            where = _of_role(sensor, ("force", "pressure"))
            _check_count(sensor, "force", force.sensitivity.shape, len(where))
            gains = np.asarray(np.linalg.inv(force.sensitivity).T, float)
            self._gains.append((where, gains))
            self.channels = _measuring("force", "N", self.channels, where, np.diag(gains))
        if taxels is not None:
            self._where = _of_role(sensor, ("taxel",))
            _check_count(sensor, "taxel", taxels.gain.shape, len(self._where))
            dead = ~np.isfinite(taxels.gain)
            self._gains.append((self._where, np.diag(np.where(dead, 1.0, taxels.gain))))
            self.channels = _measuring("taxel", "Pa", self.channels, self._where, taxels.gain)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sensor, name)

    def read(self) -> Block:
        """The device's block, calibrated."""
        block = self._sensor.read()
        if not len(block.time_s):
            return block
        time_s, saturated, values = block.time_s, block.saturated, block.values.copy()
        for where, gains in self._gains:
            values[:, where] = values[:, where] @ gains
        if self._taxels is not None:
            share = block.values[:, self._where] / self._taxels.span
            saturated = saturated.copy()
            saturated[:, self._where] |= share >= CLIPPED
        if self._latency is not None:
            time_s = self._latency.true_time(time_s)
        return Block(time_s, values, saturated, block.lost, block.jumped_s)


class CalibratedStage:
    """A stage whose axes' errors are put right: poses are true ones, both ways.

    Whatever else a stage may have (`drivers.Stage`) is its own; `base_pose` is in the arm's frame,
    before any calibration.
    """

    def __init__(self, stage: Stage, axes: AxesCalibration) -> None:
        self._stage = stage
        self._axes = axes

    def __getattr__(self, ability: str) -> Any:
        return getattr(self._stage, ability)

    def pose(self) -> Pose:
        """The true pose."""
        return _placed(self._stage.pose(), self._axes.true)

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off for the reading at which the tip is at ``target``."""
        self._stage.move(_placed(target, self._axes.command), speed_m_s)

    def search(self, target: Pose, speed_m_s: float) -> None:
        """As `move`, by a stage that ends such a move at a contact."""
        abilities.move(self._stage, _placed(target, self._axes.command), speed_m_s, search=True)

    def unreachable(self, poses: Sequence[Pose]) -> dict[Pose, str]:
        """Those true poses whose readings the device cannot go to, and why."""
        return self._of_true(poses, abilities.unreachable)

    def beyond_limits(self, poses: Sequence[Pose]) -> dict[Pose, str]:
        """Those true poses whose readings are out of its bounds, and why."""
        return self._of_true(poses, abilities.beyond_limits)

    def _of_true(
        self, poses: Sequence[Pose], ask: Callable[[Stage, Sequence[Pose]], dict[Pose, str]]
    ) -> dict[Pose, str]:
        readings = [_placed(pose, self._axes.command) for pose in poses]
        far = ask(self._stage, readings)
        both = zip(poses, readings, strict=True)
        return {pose: far[reading] for pose, reading in both if reading in far}


def calibrated(
    stage: Stage,
    sensors: Sequence[Sensor],
    files: Mapping[str, str],
    *,
    stand_ins: Collection[str] = (),
) -> tuple[Stage, tuple[Sensor, ...], tuple[str, ...]]:
    """The devices with their calibrations, and notes about old ones.

    ``stand_ins`` are absent devices: what was measured on them does not hold for what simulates
    them. Raises `CalibrationError` where a file belongs to none of the rig's devices.
    """
    notes: list[str] = []
    found: dict[str, dict[str, Any]] = {}
    for key, name in files.items():
        device = owner(key, Path(name), stage.name, [s.name for s in sensors], stand_ins)
        if device in stand_ins:
            notes.append(f"calibration.{key} is {device}'s, which is simulated: not applied")
            continue
        one, remarks = use(Path(name), device)
        notes += remarks
        if one.KIND in found.setdefault(device, {}):
            raise CalibrationError(f"calibration.{key}: {device} has two of {one.KIND}; keep one")
        found[device][one.KIND] = one
    for device, own in found.items():
        if "axes" in own:
            stage = CalibratedStage(stage, own["axes"])
        if of_sensor := {kind: own[kind] for kind in SENSOR_KINDS if kind in own}:
            sensors = [CalibratedSensor(s, **of_sensor) if s.name == device else s for s in sensors]
    return stage, tuple(sensors), tuple(notes)


def owner(
    key: str, file: Path, stage: str, sensors: Sequence[str], stand_ins: Collection[str] = ()
) -> str:
    """The rig's device that a file was made for. Raises `CalibrationError` if it is none."""
    one, kind = named(key, file), kind_of(key)
    known = [*sensors] if kind in SENSOR_KINDS else [stage]
    if one.device not in {*known, *stand_ins}:
        what = "sensors are" if kind in SENSOR_KINDS else "stage is"
        raise CalibrationError(
            f"{file}: made for {one.device!r}; this rig's {what} {', '.join(known)}. Calibrate "
            "this device, or name its own file"
        )
    return one.device


def named(key: str, file: Path) -> Record:
    """The file that a key names. Raises `CalibrationError` if it is one of another kind."""
    one = load(file)
    if one.kind != kind_of(key):
        raise CalibrationError(f"calibration.{key}: {file} is a calibration of {one.kind}")
    return one


def kind_of(key: str) -> str:
    """``force`` of ``force`` or ``force_left``. Raises `CalibrationError` for what no scan uses."""
    kind, more, _ = key.partition("_")
    if kind not in KINDS:
        raise CalibrationError(
            f"calibration.{key}: {kind!r} is no kind of calibration that a scan applies; these are "
            f"{', '.join(KINDS)}"
        )
    if more and kind in STAGE_KINDS:
        raise CalibrationError(f"calibration.{key}: a rig has one stage; say calibration.{kind}")
    return kind


def surface_of(file: str) -> Surface:
    """The measured surface for the planner. Raises `CalibrationError`."""
    one = restore(load(Path(file)), file)
    if not isinstance(one, SurfaceCalibration):
        raise CalibrationError(f"{file}: a calibration of {one.KIND}, not of the surface")
    try:
        np.asarray_chkfinite(one.height(0.0, 0.0))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise CalibrationError(f"{file}: its surface has no height: {error}") from None
    return one.height


def compliance_of(file: str) -> float:
    """How far the rig gives way [m/N]. Raises `CalibrationError`."""
    one = restore(load(Path(file)), file)
    if not isinstance(one, ComplianceCalibration):
        raise CalibrationError(f"{file}: a calibration of {one.KIND}, not of compliance")
    if not one.stiffness_n_m > 0:
        raise CalibrationError(f"{file}: stiffness_n_m = {one.stiffness_n_m:g}: must be above 0")
    return 1 / one.stiffness_n_m


def _of_role(sensor: Sensor, roles: tuple[str, ...]) -> list[int]:
    return [n for n, channel in enumerate(sensor.channels) if channel.role in roles]


def _check_count(sensor: Sensor, role: str, shape: tuple[int, ...], channels: int) -> None:
    """A scan takes as many loads as channels."""
    if set(shape) != {channels}:
        loads = f" for {shape[1]} loads" if len(shape) > 1 else ""
        raise CalibrationError(
            f"its {role} calibration has {shape[0]} channels{loads}; {sensor.name} has "
            f"{channels} of that role, and a scan needs a load for each"
        )


def _measuring(
    role: str, unit: str, channels: tuple[Channel, ...], where: list[int], gains: Array
) -> tuple[Channel, ...]:
    """Channels as a calibration leaves those of ``where`` (k,), with their own ``gains`` (k,): in
    ``unit``, a full scale too. One without a gain (NaN) is dead, and measures nothing."""
    changed = list(channels)
    for n, gain in zip(where, np.abs(gains).tolist(), strict=True):
        if np.isnan(gain):
            changed[n] = replace(channels[n], role="other")
            continue
        full = channels[n].full_scale
        full_scale = None if full is None else gain * full
        changed[n] = replace(channels[n], unit=unit, role=role, full_scale=full_scale)
    return tuple(changed)


def _placed(pose: Pose, change: Callable[[Array], Array]) -> Pose:
    x, y, z = change(np.array(pose[:3])).tolist()
    return pose._replace(x=x, y=y, z=z)
