"""Readings for a force calibration taken from the sensor itself, weight by weight."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from calibration.errors import CalibrationError
from drivers import Clock, Sensor
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
    cannot be read is asked for again, and so is one whose reading is still moving. Raises
    `CalibrationError` where the sensor has no channel of force or the table exists already, and
    `DeviceFault` when it is lost; what was taken until then is in the table.
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
        raise CalibrationError(f"{path} exists already: move it, or give another --readings-out")
    names = " ".join(sensor.channels[n].name for n in where)
    what = "load" if one else f"loads on {names}"
    show(f"{sensor.name}: put a load on, say it as 0.5 (N) or 50g or 0.2kg; Enter alone ends")
    path.write_text(",".join(head) + "\n", encoding="utf-8")
    sensor.start()
    try:
        number = 0
        while answer := ask(f"{what} {number + 1}: ").strip():
            try:
                loads_n = [newtons(word) for word in answer.split()]
                if len(loads_n) != len(where):
                    raise ValueError(f"{len(where)} numbers are needed, one for each of {names}")
            except ValueError as error:
                show(str(error))
                continue
            mean, spread, moving = _take(sensor, clock, where)
            said = ", ".join(f"{m:.6g}" for m in mean)
            if moving:
                show(f"  {said}: still moving; let it come to rest and say it again")
                continue
            with path.open("a", encoding="utf-8", newline="") as file:
                csv.writer(file).writerow([*map(repr, map(float, mean)), *map(repr, loads_n)])
            number += 1
            noise = ", ".join(f"{s:.2g}" for s in spread)
            show(f"  {said} {sensor.channels[where[0]].unit} (noise {noise} rms)")
    finally:
        sensor.stop()


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
    apart = np.abs(first.mean(axis=0) - second.mean(axis=0))
    # a sensor's own noise may be slow, so halves may differ by it, and by a step of the readings
    step = np.array([_step(values[:, k]) for k in range(values.shape[1])])
    return values.mean(axis=0), spread, bool((apart > spread + step).any())


def _step(values: Array) -> float:
    apart = np.diff(np.unique(values))
    return float(apart.min()) if len(apart) else 0.0
