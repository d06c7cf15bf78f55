"""Solve the points of a sweep: those that differ in pressure only share one solution."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from probe.studies.vary import Point, applied
from sim_backend.press import CannotSolve, Press, press
from sim_backend.scene import Scene, SceneError

Row = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """Points that are one press at several pressures: ``points`` are (number, point)."""

    scene: Scene
    points: tuple[tuple[int, Point], ...]
    x_mm: float | None
    indentation_mm: float
    model: str
    accuracy_pct: float


def jobs(
    scene: Scene, points: Iterable[tuple[int, Point]], x_mm: float | None, indentation_mm: float,
    model: str, accuracy_pct: float,
) -> list[Job]:  # fmt: skip
    """Points grouped by all but the pulse."""
    groups: dict[str, list[tuple[int, Point]]] = {}
    for number, point in points:
        section = {k: v for k, v in point.items() if not k.startswith("pulse.")}
        groups.setdefault(json.dumps(section, sort_keys=True), []).append((number, point))
    return [Job(scene, tuple(g), x_mm, indentation_mm, model, accuracy_pct)
            for g in groups.values()]  # fmt: skip


def solve(job: Job) -> list[Row]:
    """A row for every point; one that cannot be solved has its ``reason``, and no values."""
    scenes: dict[int, Scene] = {}
    rows: list[Row] = []
    for number, point in job.points:
        try:
            scenes[number] = applied(job.scene, point)
        except (SceneError, ValidationError) as error:
            rows.append(_row(number, point) | {"reason": first_line(error)})
    if not scenes:
        return rows
    first = next(iter(scenes.values()))
    place = dict(job.points)[next(iter(scenes))]
    x_mm = float(place.get("x_mm", _x_mm(first) if job.x_mm is None else job.x_mm))
    depth_mm = float(place.get("indentation_mm", job.indentation_mm))
    levels = sorted({p for s in scenes.values() for p in _pressures(s)})
    try:
        pressed = press(
            first, x_mm, depth_mm, levels, model=job.model, accuracy_pct=job.accuracy_pct
        )
    except (CannotSolve, SceneError) as error:
        failed = {"x_mm": x_mm, "indentation_mm": depth_mm, "reason": first_line(error)}
        return rows + [_row(n, p) | failed for n, p in job.points if n in scenes]
    return rows + [
        _row(n, p) | _answer(pressed, scenes[n], levels) for n, p in job.points if n in scenes
    ]


def _pressures(scene: Scene) -> tuple[float, ...]:
    if not scene.arteries:
        return (0.0,)
    return (scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg)


def _answer(pressed: Press, scene: Scene, levels: list[float]) -> Row:
    low, high = (pressed.states[levels.index(p)] for p in
                 (_pressures(scene)[0], _pressures(scene)[-1]))  # fmt: skip
    finger = scene.indenter
    face_m2 = 1e-6 * finger.width_mm_projected * finger.length_mm
    force_n, pulse_n = (finger.length_mm * f for f in
                        (low.force_n_per_mm, high.force_n_per_mm - low.force_n_per_mm))  # fmt: skip
    return {
        "x_mm": pressed.x_mm,
        "indentation_mm": pressed.depth_mm,
        "force_n": force_n,
        "pulse_n": pulse_n,
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


def _row(number: int, point: Point) -> Row:
    return {"point": number, **point}


def _x_mm(scene: Scene) -> float:
    """Over the first inclusion, or the middle of the block."""
    if scene.inclusion:
        return float(scene.inclusion[0].x_mm)
    return 0.5 * scene.tissue.width_mm if scene.tissue else 0.0


def first_line(error: Exception) -> str:
    """What was wrong, in one line."""
    if isinstance(error, ValidationError):
        one = error.errors()[0]
        where = ".".join(str(part) for part in one["loc"])
        text = str(one["msg"]).removeprefix("Value error, ")
        return f"{where}: {text}" if where else text
    return str(error).splitlines()[0]
