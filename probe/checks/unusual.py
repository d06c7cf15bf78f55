"""Unusual values in a rig file or a scene, which may be in another unit than their key's.

Metres given for millimetres, milliseconds for seconds, millinewtons for newtons. Nothing is opened.
"""

from collections.abc import Iterator, Mapping
from typing import Any, TypeGuard

from drivers import ConfigError
from drivers.core.registry import Kind, settings_of
from probe.checks.preflight import Check
from probe.config.rig import Device, Rig
from sim_backend.scene.odd_values import doubt, odd_values
from sim_backend.scene.scene_file import Scene

UNITS = ("baud", "_mm", "_mm_s", "_s", "_n", "_hz", "_ms")
"""How keys of quantities end; counts and angles are not looked at."""
NOT_SIZES = ("start_mm", "indentation_mm", "time_unit_s")
"""A place may be near zero, a unit anything; of shallow presses `probe.checks.dry_run` says
more."""
FACE_MM2 = 100.0
"""The probe's face in all rigs of ``rigs/``: a fingertip's contact, 11 mm across."""
NEAREST_MM = 1.0
"""GRBL backs off its switches by so much before it is at home ($27, by default), and no arm reaches
into its own base: a scan's origin does not lie nearer to a machine's."""


def unusual(rig: Rig, scene: Scene | None = None) -> Iterator[Check]:
    """A warning for each quantity that may have been given in another unit, and a fault where
    positions come too seldom for any scan."""
    if scene is not None:
        yield from (Check("values", "warning", f"scene: {text}") for text in odd_values(scene))
    for table, one in (("scan", rig.scan), ("safety", rig.safety)):
        usual = {key: field.default for key, field in type(one).model_fields.items()}
        yield from _off(table, dict(one), usual)
    if rig.face_mm2 is not None and (words := doubt("face_mm2", rig.face_mm2, FACE_MM2)):
        yield Check("values", "warning", words)
    yield from _of_device("stages", "stage", rig.stage)
    for n, device in enumerate(rig.sensor):
        yield from _of_device("sensors", f"sensor[{n}]", device)


def _of_device(kind: Kind, where: str, device: Device) -> Iterator[Check]:
    """Of a device's own keys, by what its driver takes without them."""
    if device.driver == "virtual":  # it may be as odd as one likes
        return
    try:
        fields = settings_of(kind, device.driver).model_fields
    except (ConfigError, ImportError):  # said where the device is made
        return
    usual = {key: field.default for key, field in fields.items()}
    yield from _off(where, device.settings, usual)
    keys = usual | device.settings
    status_hz, silent_s = keys.get("status_hz"), keys.get("silent_s")
    if _is_size(status_hz) and _is_size(silent_s) and status_hz * silent_s < 1:
        yield Check(
            "values",
            "fault",
            f"{where}.status_hz = {status_hz:g}: a position every {1 / status_hz:g} s is older "
            f"than {where}.silent_s = {silent_s:g} allows, which ends any scan; ask for more than "
            f"{1 / silent_s:g} a second, {usual['status_hz']:g} is usual",
        )
    origin_mm = device.settings.get("origin_mm", ())
    farthest_mm = max((abs(one) for one in origin_mm if isinstance(one, int | float)), default=0.0)
    if 0 < farthest_mm < NEAREST_MM:
        yield Check(
            "values",
            "warning",
            f"{where}.origin_mm = {list(origin_mm)}: less than {NEAREST_MM:g} mm from the "
            "machine's own zero, where no probe is; the key is in millimetres",
        )


def _off(where: str, given: Mapping[str, Any], usual: Mapping[str, Any]) -> Iterator[Check]:
    for key, value in given.items():
        if key in NOT_SIZES or not key.endswith(UNITS) or not _is_size(usual.get(key)):
            continue
        for one in value if isinstance(value, tuple) else (value,):
            if _is_size(one) and (words := doubt(f"{where}.{key}", one, usual[key])):
                yield Check("values", "warning", words)


def _is_size(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and value > 0
