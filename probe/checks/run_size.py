"""How long a scan takes, how large its run becomes, and whether the disk has room for it."""

import math
import shutil
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal

from drivers import Sensor
from probe.core.errors import StoreError
from probe.guards.device_facts import SensorFacts
from probe.guards.levels import LEVEL_S
from probe.guards.readings import PUBLISH_S, STAGE_CHANNELS
from probe.guards.safety_monitor import STAGE_PERIOD_S
from probe.planning.plan import TOUCH_GAP_M, TOUCH_M_S, Plan
from probe.storage.rows import bytes_per_s

DISK_RESERVE = 2.0


def scan_seconds(plan: Plan) -> float:
    """How long the scan takes from above its first station on, without the stage's acceleration.

    A surface that is found by touch is taken to lie where it is planned: see `search_seconds`.
    """
    height, count = plan.travel_z_m, len(plan.places)
    drops = sum(height - plan.at_surface(place).z for place in plan.places)
    ways = sum(math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) for a, b in pairwise(plan.places))
    lifts = drops + count * plan.indentation_m
    touch_s = 0.0
    if plan.touch_n is not None:
        touch_s = TOUCH_GAP_M / TOUCH_M_S - TOUCH_GAP_M / plan.approach_m_s
    level_s = plan.settle_s + LEVEL_S  # in the air, before each tare and after the last press
    away_s = 2 * plan.clearance_m / plan.travel_m_s + level_s + plan.settle_s  # at the first tare
    each_s = level_s + touch_s + plan.ramp_s + plan.hold_s + LEVEL_S  # `lifting` takes one too
    moves_s = (ways + lifts) / plan.travel_m_s + drops / plan.approach_m_s
    if plan.force_n is not None:  # a step after the way down is usual, and a rest after each
        each_s += (1 + len(plan.steps_n)) * 2 * level_s
    each_s += plan.steps * plan.step_hold_s
    return moves_s + count * each_s + away_s + level_s


def search_seconds(plan: Plan) -> float:
    """How much longer it takes at most where the surface lies deeper than planned."""
    return 0.0 if plan.touch_n is None else len(plan.places) * plan.search_m / TOUCH_M_S


def run_bytes(plan: Plan, sensors: Sequence[Sensor | SensorFacts]) -> float:
    """How large [bytes] the run of a scan becomes at most."""
    read = [(1 / STAGE_PERIOD_S, len(STAGE_CHANNELS))]
    read += [(sensor.rate_hz, len(sensor.channels)) for sensor in sensors]
    growth = sum(bytes_per_s(rate_hz, count, 1 / PUBLISH_S) for rate_hz, count in read)
    return (scan_seconds(plan) + search_seconds(plan)) * growth


def room(out: Path, size_bytes: float) -> tuple[Literal["ok", "warning", "fault"], str]:
    """The level and the words of a dry run's check that the disk of ``out`` has room for a run of
    this size: a fault without, a warning where the disk does not say."""
    folder, needed = out, f"needs {size_bytes / 1e6:.1f} MB"
    times = f"{DISK_RESERVE:g} times what it needs"
    try:
        folder = out.absolute()
        folder = next((p for p in (folder, *folder.parents) if p.exists()), folder)
        disk = shutil.disk_usage(folder)
        why = "it says that it is 0 bytes large" if disk.total == 0 else ""  # some FUSE mounts
    except OSError as error:
        why = str(error.strerror or error)
    if why:
        return "warning", (
            f"{needed}; the room on {folder} is not known ({why}): see that {times} is free there"
        )
    text = f"{needed}, {folder} has {disk.free / 1e6:.1f} MB"
    if disk.free <= DISK_RESERVE * size_bytes:
        return "fault", f"{text}; make room there for {times}, or name another place"
    return "ok", text


def need_room(out: Path, plan: Plan, sensors: Sequence[Sensor | SensorFacts]) -> None:
    """Raises `StoreError`, in the words of a dry run, where the disk is short of room."""
    level, text = room(out, run_bytes(plan, sensors))
    if level == "fault":
        raise StoreError(f"disk: {text}")
