"""Calibrations applied to the devices of a scan: true forces at true times.

A rig file names the files: ``[calibration] force = "force-ft300.json"``. A file of another device
is refused, an old one used with a note; what was applied is in every run.
"""

from pathlib import Path

import numpy as np

from calibration import ForceCalibration, LatencyCalibration, SurfaceCalibration, use
from calibration.errors import CalibrationError
from drivers import Block, Channel, Sensor
from probe.plan import Surface

SENSOR_KINDS = ("force", "latency")
KINDS = (*SENSOR_KINDS, "surface")


class CalibratedSensor:
    """A sensor whose force channels and times are put right; all else is the device's own."""

    def __init__(
        self, sensor: Sensor, force: ForceCalibration | None, latency: LatencyCalibration | None
    ) -> None:
        self._sensor = sensor
        self._force = force
        self._latency = latency
        self._where = [n for n, c in enumerate(sensor.channels) if c.role in ("force", "pressure")]
        if force is not None and len(force.sensitivity) != len(self._where):
            raise CalibrationError(
                f"calibration.force has {len(force.sensitivity)} channels; {sensor.name} has "
                f"{len(self._where)} of force"
            )

    @property
    def name(self) -> str:
        return self._sensor.name

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._sensor.channels

    @property
    def rate_hz(self) -> float:
        return self._sensor.rate_hz

    def connect(self) -> None:
        self._sensor.connect()

    def start(self) -> None:
        self._sensor.start()

    def read(self) -> Block:
        """The device's block, calibrated. The device's tare is the offset: only gains act."""
        block = self._sensor.read()
        values, time_s = block.values, block.time_s
        if self._force is not None and len(values):
            values = values.copy()
            gains = np.linalg.pinv(self._force.sensitivity).T
            values[:, self._where] = values[:, self._where] @ gains
        if self._latency is not None:
            time_s = self._latency.true_time(time_s)
        return Block(time_s, values, block.saturated, block.lost)

    def tare(self) -> None:
        self._sensor.tare()

    def stop(self) -> None:
        self._sensor.stop()

    def close(self) -> None:
        self._sensor.close()


def calibrated(
    sensors: tuple[Sensor, ...], files: dict[str, str]
) -> tuple[tuple[Sensor, ...], tuple[str, ...]]:
    """The sensors with their calibrations, and notes about old ones.

    ``force`` and ``latency`` belong to the sensor they were made for. Raises `CalibrationError`
    where that is none of these.
    """
    notes: list[str] = []
    done = list(sensors)
    names = [sensor.name for sensor in sensors]
    found: dict[str, dict[str, ForceCalibration | LatencyCalibration]] = {}
    for kind in SENSOR_KINDS:
        if kind not in files:
            continue
        device, one, told = _of_one_of(Path(files[kind]), names)
        notes += told
        found.setdefault(device, {})[kind] = one
    for device, kinds in found.items():
        at = names.index(device)
        force, latency = kinds.get("force"), kinds.get("latency")
        done[at] = CalibratedSensor(
            sensors[at],
            force if isinstance(force, ForceCalibration) else None,
            latency if isinstance(latency, LatencyCalibration) else None,
        )
    return tuple(done), tuple(notes)


def _of_one_of(
    path: Path, names: list[str]
) -> tuple[str, ForceCalibration | LatencyCalibration, tuple[str, ...]]:
    from calibration import load

    device = load(path).device
    if device not in names:
        raise CalibrationError(
            f"{path}: made for {device!r}; this rig's sensors are {', '.join(names)}"
        )
    one, notes = use(path, device)
    if not isinstance(one, ForceCalibration | LatencyCalibration):
        raise CalibrationError(f"{path}: a calibration of {one.KIND}, not of a sensor")
    return device, one, notes


def surface_of(file: str) -> Surface:
    """The measured surface for the planner. Raises `CalibrationError`."""
    from calibration import load, restore

    one = restore(load(Path(file)), file)
    if not isinstance(one, SurfaceCalibration):
        raise CalibrationError(f"{file}: a calibration of {one.KIND}, not of the surface")
    try:
        np.asarray_chkfinite(one.height(0.0, 0.0))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise CalibrationError(f"{file}: its surface has no height: {error}") from None
    return one.height
