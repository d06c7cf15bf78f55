"""Readings for a force calibration taken from the sensor itself, weight by weight."""

import csv
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np

from calibration.errors import CalibrationError
from calibration.rounding import least_step
from drivers import Clock, DeviceFault, Sensor
from drivers.core.arrays import Array
from drivers.core.units import to_si

TAKE_S = 2.0
"""A load's reading is the mean over this."""
ROLES = ("force", "pressure")
WEIGHTS = ("kg", "g")
"""By standard gravity (CGPM 1901). The true one differs by up to 0.3 %: say newtons where that
matters."""


def take_weights(
    sensor: Sensor,
    clock: Clock,
    path: Path,
    ask: Callable[[str], str],
    show: Callable[[str], None],
) -> None:
    """Ask for each load, take its reading, and append both to the table ``path``, until an empty
    answer. ``path`` is what `calibration.fit_force` wants: ``raw`` and ``load_n``, numbered where
    the sensor has several channels of force.

    The sensor must be connected; it is neither tared nor asked for its calibration. A load that
    cannot be read is asked for again, and so is one whose reading is still moving or at the end of
    the range; ``undo`` takes the last one back. Raises `CalibrationError` where the sensor has no
    channel of force or the table exists already, and `DeviceFault` when it is lost. It and Ctrl-C
    say how many loads are in the table; without one there is no table.
    """
    where = [n for n, channel in enumerate(sensor.channels) if channel.role in ROLES]
    if not where:
        raise CalibrationError(f"{sensor.name} has no channel of role force or pressure")
    one = len(where) == 1
    head = (
        ["raw", "load_n"]
        if one
        else [f"raw_{n}" for n in range(len(where))] + [f"load_{n}_n" for n in range(len(where))]
    )
    if path.exists():
        raise CalibrationError(
            f"{path} exists already: fit it by {_command(sensor, path)}, move it, or give another "
            "--readings-out"
        )
    names = " ".join(sensor.channels[n].name for n in where)
    what = "load" if one else f"loads on {names}"
    show(
        f"{sensor.name}: put a load on, say it as 0.5 (N) or 50g or 0.2kg; undo takes the last one "
        "back; Enter alone ends"
    )
    sensor.start()
    rows: list[list[str]] = []
    try:
        while answer := ask(f"{what} {len(rows) + 1}: ").strip():
            if answer == "undo":
                show(
                    f"  taken back: {rows.pop()[-1]} N" if rows else "  there is none to take back"
                )
                _write(path, head, rows)
                continue
            try:
                loads_n = [newtons(word) for word in answer.split()]
                if len(loads_n) != len(where):
                    raise ValueError(f"{len(where)} numbers are needed, one for each of {names}")
                mean, spread, moving = _take(sensor, clock, where)
            except (ValueError, CalibrationError) as error:
                show(str(error))
                continue
            said = ", ".join(f"{m:.6g}" for m in mean)
            if moving:
                show(f"  {said}: still moving; let it come to rest and say it again")
                continue
            rows.append([*map(repr, map(float, mean)), *map(repr, loads_n)])
            _write(path, head, rows)
            noise = ", ".join(f"{s:.2g}" for s in spread)
            show(f"  {said} {sensor.channels[where[0]].unit} (noise {noise} rms)")
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_kept(sensor, path, rows)) from None
    except DeviceFault as fault:
        raise DeviceFault(fault.device, f"{fault.reason}; {_kept(sensor, path, rows)}") from None
    finally:
        sensor.stop()


def _write(path: Path, head: list[str], rows: list[list[str]]) -> None:
    """The whole table, in one piece; none without a row."""
    if not rows:
        path.unlink(missing_ok=True)
        return
    part = path.with_name(f"{path.name}.part")
    with part.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([head, *rows])
    part.replace(path)


def _kept(sensor: Sensor, path: Path, rows: list[list[str]]) -> str:
    if not rows:
        return "no load was taken"
    return f"{len(rows)} loads are kept in {path}: {_command(sensor, path)} fits them"


def _command(sensor: Sensor, path: Path) -> str:
    return shlex.join(["palpate", "calibrate", "force", str(path), "--device", sensor.name])


def newtons(word: str) -> float:
    """``0.5``, ``0.5N``, ``50g`` or ``0.2kg`` as N. Raises ValueError with what is allowed."""
    text = word.lower().removesuffix("n")
    factor = 1.0
    for unit in WEIGHTS:
        if text.endswith(unit):
            text, factor = text.removesuffix(unit), to_si(unit)[1]
            break
    try:
        value = float(text) * factor
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise ValueError(f"{word!r} is no load: say 0.5 (N), 50g or 0.2kg")
    if value < 0 and factor != 1.0:
        raise ValueError(f"{word!r}: a weight is not negative; say a pull in newtons, as -0.5")
    return value


def _take(sensor: Sensor, clock: Clock, where: list[int]) -> tuple[Array, Array, bool]:
    """Mean and noise (k,) over `TAKE_S`, and whether it moved meanwhile."""
    sensor.read()  # what came while the load was put on
    until_s = clock.now() + TAKE_S
    blocks = []
    while clock.now() < until_s:
        clock.sleep_until(min(clock.now() + 0.05, until_s))
        block = sensor.read()
        if block.saturated.any():
            raise CalibrationError(f"{sensor.name}: the reading is at the end of its range")
        blocks.append(block.values)
    values = np.concatenate(blocks)[:, where]
    if len(values) < 4:
        raise CalibrationError(f"{sensor.name}: {len(values)} samples in {TAKE_S:g} s")
    spread = values.std(axis=0, ddof=1)
    first, second = np.array_split(values, 2)
    drift = np.abs(first.mean(axis=0) - second.mean(axis=0))
    # a sensor's own noise may be slow, so halves may differ by it, and by a step of the readings
    step = np.array([least_step(values[:, k]) for k in range(values.shape[1])])
    return values.mean(axis=0), spread, bool((drift > spread + step).any())
