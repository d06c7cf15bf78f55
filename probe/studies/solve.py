"""Solve the points of a sweep: presses that differ in pressure only share one solution."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from pydantic import ValidationError

from probe.studies.vary import Point, applied
from sim_backend.models.press import CannotSolve, Press, press, scene_pressures_mmhg
from sim_backend.models.press_range import check_press
from sim_backend.models.refine import SMALL_PULSE
from sim_backend.models.response import StationResponse
from sim_backend.models.station_response import respond
from sim_backend.scene.explain import explain
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.waves import PA_PER_MMHG

Row = dict[str, Any]
Presses = dict[tuple[float, float], dict[int, Scene]]
"""By place and depth [mm], the scenes that are pressed there, by their points' numbers."""


@dataclass(frozen=True)
class Job:
    """Points that are the same presses at several pressures: ``points`` are (number, point).

    ``x_mm``: where, over the first inclusion if empty.
    """

    scene: Scene
    points: tuple[tuple[int, Point], ...]
    x_mm: tuple[float, ...]
    indentation_mm: float
    model: str
    accuracy_pct: float


def jobs(
    scene: Scene, points: Iterable[tuple[int, Point]], x_mm: tuple[float, ...],
    indentation_mm: float, model: str, accuracy_pct: float,
) -> list[Job]:  # fmt: skip
    """Points grouped by what they do not share: all but the pulse, for stations all but pulse and
    press."""
    free = ("pulse.", "x_mm", "indentation_mm") if model == "quick" else ("pulse.",)
    groups: dict[str, list[tuple[int, Point]]] = {}
    for number, point in points:
        shared = {k: v for k, v in point.items() if not k.startswith(free)}
        groups.setdefault(json.dumps(shared, sort_keys=True), []).append((number, point))
    return [Job(scene, tuple(g), x_mm, indentation_mm, model, accuracy_pct)
            for g in groups.values()]  # fmt: skip


def solve(job: Job) -> dict[int, list[Row]]:
    """By point, a row for every place; what cannot be solved has its ``reason``, and no values."""
    presses: dict[tuple[float, float], dict[int, Scene]] = {}
    rows: dict[int, list[Row]] = {}
    for number, point in job.points:
        try:
            scene = applied(job.scene, point)
        except (SceneError, ValidationError) as error:
            rows[number] = [{"reason": first_line(error)}]
            continue
        over = (float(point["x_mm"]),) if "x_mm" in point else job.x_mm or (_x_mm(scene),)
        depth_mm = float(point.get("indentation_mm", job.indentation_mm))
        for x_mm in over:
            presses.setdefault((x_mm, depth_mm), {})[number] = scene
    for number, row in (_stations if job.model == "quick" else _pressed)(job, presses):
        rows.setdefault(number, []).append(row)
    return {n: [{"point": n, **point, **row} for row in rows[n]] for n, point in job.points}


def _pressed(job: Job, presses: Presses) -> Iterator[tuple[int, Row]]:
    """One press at the pressures of all scenes."""
    for (x_mm, depth_mm), scenes in presses.items():
        levels = sorted({p for scene in scenes.values() for p in scene_pressures_mmhg(scene)})
        try:
            pressed = press(next(iter(scenes.values())), x_mm, depth_mm, levels,
                            solving=lambda _what: None, model=job.model,
                            accuracy_pct=job.accuracy_pct)  # fmt: skip
        except (CannotSolve, SceneError) as error:
            yield from _failed(scenes, x_mm, depth_mm, error)
            continue
        for number, scene in scenes.items():
            yield number, _press_row(pressed, scene, levels)


def _stations(job: Job, presses: Presses) -> Iterator[tuple[int, Row]]:
    """A station at each place, solved for the widest pulse and the deepest press there; by presses
    where that has no equilibrium."""
    places: dict[float, dict[float, dict[int, Scene]]] = {}
    for (x_mm, depth_mm), scenes in presses.items():
        places.setdefault(x_mm, {})[depth_mm] = scenes
    for x_mm, depths in places.items():
        for depth_mm, scenes in list(depths.items()):
            try:
                check_press(next(iter(scenes.values())), x_mm, depth_mm)
            except SceneError as error:
                yield from _failed(depths.pop(depth_mm), x_mm, depth_mm, error)
        if not depths:
            continue
        began_s = perf_counter()
        try:
            station = respond(_widest(depths.values()), 1e-3 * x_mm, 1e-3 * max(depths))
        except (CannotSolve, SceneError):  # the widest pulse says nothing of the others
            one_by_one = {(x_mm, depth_mm): scenes for depth_mm, scenes in depths.items()}
            yield from _pressed(replace(job, model="auto"), one_by_one)
            continue
        seconds = perf_counter() - began_s
        for depth_mm, scenes in depths.items():
            for number, scene in scenes.items():
                yield number, _station_row(station, scene, depth_mm) | {"seconds": seconds}


def _widest(groups: Iterable[dict[int, Scene]]) -> Scene:
    """The scene with a pulse that holds those of all."""
    scenes = [scene for group in groups for scene in group.values()]
    pulses = [scene.pulse for scene in scenes]
    ends = {"diastolic_mmhg": min(one.diastolic_mmhg for one in pulses),
            "systolic_mmhg": max(one.systolic_mmhg for one in pulses)}  # fmt: skip
    return scenes[0].model_copy(update={"pulse": pulses[0].model_copy(update=ends)})


def _failed(
    scenes: Iterable[int], x_mm: float, depth_mm: float, error: Exception
) -> Iterator[tuple[int, Row]]:
    for number in scenes:
        yield number, {"x_mm": x_mm, "indentation_mm": depth_mm, "reason": first_line(error)}


def _station_row(station: StationResponse, scene: Scene, depth_mm: float) -> Row:
    """A row of a station, with its stated errors."""
    depth_m = 1e-3 * depth_mm
    mmhg = scene_pressures_mmhg(scene)
    low_pa, half_pa, high_pa = np.array([mmhg[0], sum(mmhg) / len(mmhg), mmhg[-1]]) * PA_PER_MMHG
    force_n, half_n, high_n = station.force_n(depth_m, [low_pa, half_pa, high_pa]).tolist()
    low_vm_pa, high_vm_pa = station.von_mises_pa(depth_m, [low_pa, high_pa]).tolist()
    off_n = float(station.error_n(depth_m, low_pa))
    pulse_n, pulse_off_n = high_n - force_n, float(station.pulse_error_n(depth_m, low_pa, high_pa))
    share = max(off_n / force_n, pulse_off_n / max(abs(pulse_n), SMALL_PULSE * force_n))
    face_m2 = 1e-6 * scene.face_mm2
    return {
        "x_mm": 1e3 * station.x_m, "indentation_mm": depth_mm,
        "force_n": force_n, "pulse_n": pulse_n, "half_pulse_n": half_n - force_n,
        "force_error_n": off_n, "pulse_error_n": pulse_off_n,
        "baseline_pa": force_n / face_m2, "pulse_pa": pulse_n / face_m2,
        "von_mises_pa": low_vm_pa, "von_mises_pulse_pa": high_vm_pa - low_vm_pa,
        "model": "quick", "error_estimate_pct": 100 * share, "reason": "",
    }  # fmt: skip


def _press_row(pressed: Press, scene: Scene, levels: list[float]) -> Row:
    mmhg = scene_pressures_mmhg(scene)
    low, high = (pressed.states[levels.index(p)] for p in (mmhg[0], mmhg[-1]))
    face_m2 = 1e-6 * scene.face_mm2
    force_n, pulse_n = low.force_n, high.force_n - low.force_n
    return {
        "x_mm": pressed.x_mm,
        "indentation_mm": pressed.depth_mm,
        "force_n": force_n,
        "pulse_n": pulse_n,
        "force_error_n": 0.01 * pressed.force_error_estimate_pct * force_n,
        "pulse_error_n": pressed.pulse_error_n or 0.0,
        "baseline_pa": force_n / face_m2,
        "pulse_pa": pulse_n / face_m2,
        "von_mises_pa": low.von_mises_pa,
        "von_mises_pulse_pa": high.von_mises_pa - low.von_mises_pa,
        "contact_mm": low.contact_mm[1] - low.contact_mm[0],
        "min_jacobian": min(low.min_jacobian, high.min_jacobian),
        "model": pressed.model,
        "dofs": pressed.dofs,
        "error_estimate_pct": pressed.error_estimate_pct,
        "seconds": pressed.seconds,
        "reason": "",
    }


def _x_mm(scene: Scene) -> float:
    """Over the first inclusion, or the middle of the block."""
    if scene.inclusion:
        return float(scene.inclusion[0].x_mm)
    return 0.5 * scene.tissue.width_mm if scene.tissue else 0.0


def first_line(error: Exception) -> str:
    """What was wrong, in one line."""
    if isinstance(error, ValidationError):
        return explain(error)[0]
    return str(error).splitlines()[0]
