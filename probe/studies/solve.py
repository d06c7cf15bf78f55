"""Solve the points of a sweep: presses that differ in pressure only share one solution."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from pydantic import ValidationError

from probe.studies.vary import Point, applied
from sim_backend.models.fast import FastModel, fast_model
from sim_backend.models.press import CannotSolve, Press, press
from sim_backend.models.press_range import check_press
from sim_backend.models.refine import SMALL_PULSE
from sim_backend.models.response import OutOfRange
from sim_backend.scene.explain import explain
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.waves import PA_PER_MMHG

Row = dict[str, Any]


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
    """Points grouped by what they do not share: all but the pulse, for the fast model all but pulse
    and press (trained once per scene)."""
    free = ("pulse.", "x_mm", "indentation_mm") if model == "fast" else ("pulse.",)
    groups: dict[str, list[tuple[int, Point]]] = {}
    for number, point in points:
        shared = {k: v for k, v in point.items() if not k.startswith(free)}
        groups.setdefault(json.dumps(shared, sort_keys=True), []).append((number, point))
    return [Job(scene, tuple(g), x_mm, indentation_mm, model, accuracy_pct)
            for g in groups.values()]  # fmt: skip


def solve(job: Job) -> dict[int, list[Row]]:
    """By point, a row for every place; what cannot be solved has its ``reason``, and no values."""
    scenes: dict[int, Scene] = {}
    found: dict[int, list[Row]] = {}
    for number, point in job.points:
        try:
            scenes[number] = applied(job.scene, point)
        except (SceneError, ValidationError) as error:
            found[number] = [{"reason": first_line(error)}]
    if scenes:
        found |= (_by_table if job.model == "fast" else _by_presses)(job, scenes)
    return {n: [{"point": n, **point, **row} for row in found[n]] for n, point in job.points}


def _where(job: Job, point: Point, scene: Scene) -> tuple[tuple[float, ...], float]:
    """Places and indentation [mm]: the point's own, else the sweep's."""
    over = (float(point["x_mm"]),) if "x_mm" in point else job.x_mm or (_x_mm(scene),)
    return over, float(point.get("indentation_mm", job.indentation_mm))


def _by_presses(job: Job, scenes: dict[int, Scene]) -> dict[int, list[Row]]:
    number, first = next(iter(scenes.items()))
    over, depth_mm = _where(job, dict(job.points)[number], first)
    pressed = [_pressed(job, scenes, x_mm, depth_mm) for x_mm in over]
    return {n: [rows[n] for rows in pressed] for n in scenes}


def _by_table(job: Job, scenes: dict[int, Scene]) -> dict[int, list[Row]]:
    """All points by one fast model, trained for the widest pulse and the deepest press; by presses
    what it does not know."""
    points = dict(job.points)
    where = {n: _where(job, points[n], scene) for n, scene in scenes.items()}
    pulses = [scene.pulse for scene in scenes.values()]
    ends = {"diastolic_mmhg": min(one.diastolic_mmhg for one in pulses),
            "systolic_mmhg": max(one.systolic_mmhg for one in pulses)}  # fmt: skip
    first = next(iter(scenes.values()))
    widest = first.model_copy(update={"pulse": pulses[0].model_copy(update=ends)})
    by_press = replace(job, model="auto")
    try:
        model = fast_model(widest, max(depth_mm for _, depth_mm in where.values()))
    except (CannotSolve, SceneError):  # one press that cannot be says nothing of the others
        model = None

    rows: dict[tuple[int, float], Row] = {}
    unknown: dict[tuple[float, float], dict[int, Scene]] = {}
    for n, (over, depth_mm) in where.items():
        for x_mm in over:
            if model is not None and _knows(model, scenes[n], x_mm, depth_mm):
                rows[n, x_mm] = _fast(model, scenes[n], x_mm, depth_mm)
            else:
                unknown.setdefault((x_mm, depth_mm), {})[n] = scenes[n]
    for (x_mm, depth_mm), some in unknown.items():  # one press for all of its pressures
        pressed = _pressed(by_press, some, x_mm, depth_mm)
        rows |= {(n, x_mm): pressed[n] for n in some}
    return {n: [rows[n, x_mm] for x_mm in over] for n, (over, _) in where.items()}


def _knows(model: FastModel, scene: Scene, x_mm: float, depth_mm: float) -> bool:
    """Whether a press lies in the model's table."""
    try:
        levels_pa = np.array(_pressures(scene)) * PA_PER_MMHG
        model.range.check(1e-3 * x_mm, 1e-3 * depth_mm, levels_pa)
    except OutOfRange:
        return False
    return True


def _pressed(
    job: Job, scenes: dict[int, Scene], x_mm: float, depth_mm: float
) -> dict[int, Row]:  # fmt: skip
    """One press at the pressures of all scenes, of the quick model also half-way."""
    half = [_half(scene) for scene in scenes.values() if job.model == "quick"]
    levels = sorted({*half, *(p for scene in scenes.values() for p in _pressures(scene))})
    first = next(iter(scenes.values()))
    try:
        pressed = press(first, x_mm, depth_mm, levels, solving=lambda _what: None, model=job.model,
                        accuracy_pct=job.accuracy_pct)  # fmt: skip
    except (CannotSolve, SceneError) as error:
        failed = {"x_mm": x_mm, "indentation_mm": depth_mm, "reason": first_line(error)}
        return dict.fromkeys(scenes, failed)
    return {n: _answer(pressed, scene, levels) for n, scene in scenes.items()}


def _fast(model: FastModel, scene: Scene, x_mm: float, depth_mm: float) -> Row:
    """A row of the fast model, with its stated errors."""
    began_s = perf_counter()
    place = {"x_mm": x_mm, "indentation_mm": depth_mm}
    levels_pa = np.array(_pressures(scene)) * PA_PER_MMHG
    at = 1e-3 * x_mm, 1e-3 * depth_mm
    low_pa, high_pa = levels_pa[0], levels_pa[-1]
    try:
        check_press(scene, x_mm, depth_mm)
        low_n, half_n, high_n = model.force_n(*at, [low_pa, (low_pa + high_pa) / 2, high_pa])
        off_n = float(model.error_n(*at, low_pa))
        pulse_off_n = float(model.pulse_error_n(*at, low_pa, high_pa))
        stress_pa = model.von_mises_pa(*at, levels_pa)
    except (CannotSolve, SceneError, OutOfRange) as error:
        return place | {"reason": first_line(error)}
    force_n, pulse_n, face_m2 = float(low_n), float(high_n - low_n), 1e-6 * scene.face_mm2
    share = max(off_n / force_n, pulse_off_n / max(abs(pulse_n), SMALL_PULSE * force_n))
    return place | {
        "force_n": force_n, "pulse_n": pulse_n, "half_pulse_n": float(half_n - low_n),
        "baseline_pa": force_n / face_m2, "pulse_pa": pulse_n / face_m2,
        "force_error_n": off_n, "pulse_error_n": pulse_off_n, "model": "fast",
        "von_mises_pa": float(stress_pa[0]),
        "von_mises_pulse_pa": float(stress_pa[-1] - stress_pa[0]),
        "error_estimate_pct": 100 * share, "seconds": perf_counter() - began_s, "reason": "",
    }  # fmt: skip


def _pressures(scene: Scene) -> tuple[float, ...]:
    if not scene.arteries:
        return (0.0,)
    return (scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg)


def _half(scene: Scene) -> float:
    return sum(_pressures(scene)) / len(_pressures(scene))


def _answer(pressed: Press, scene: Scene, levels: list[float]) -> Row:
    low, high = (pressed.states[levels.index(p)] for p in
                 (_pressures(scene)[0], _pressures(scene)[-1]))  # fmt: skip
    face_m2 = 1e-6 * scene.face_mm2
    force_n, pulse_n = low.force_n, high.force_n - low.force_n
    half = [one.force_n - force_n for one in pressed.states if one.pressure_mmhg == _half(scene)]
    return {
        "x_mm": pressed.x_mm,
        "indentation_mm": pressed.depth_mm,
        "force_n": force_n,
        "pulse_n": pulse_n,
        **({"half_pulse_n": half[0]} if half else {}),
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
