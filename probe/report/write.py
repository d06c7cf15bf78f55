"""Writes a run's report: the page and its figures as PNG, SVG and PDF."""

import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.core.files import naming
from probe.core.contact_stress import stress_conversion, tactile_device
from probe.core.events import RunStarted, Samples
from probe.core.places import place_words
from probe.core.recording import Recording, Station
from probe.report import figures
from probe.report.anonymous import anonymous
from probe.report.page import Picture, page
from probe.report.taxel_figure import taxels
from sim_backend.scene.scene_file import Scene

if TYPE_CHECKING:
    from probe.storage.run import Run

DPI = 300


def write_report(
    run_path: str | PathLike[str], out_dir: str | Path, *, without_names: bool = False
) -> Path:
    """Write a run's report: a page and its figures.

    Parameters
    ----------
    run_path
        The run file.
    out_dir
        Where ``report.html`` and the figures (PNG, SVG, PDF) go.
    without_names
        Leave out who, where and when: see `probe.report.anonymous`.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    RunFileError
        The file is no run, or nothing was measured.
    """
    from probe.detection import detect  # here: reading and detecting are not needed to draw
    from probe.storage.run import open_run

    run = open_run(run_path)
    shown = Path("anonymous.run") if without_names else run.path
    started = next(event for event in run.events() if isinstance(event, RunStarted))
    recording = run.recording()
    if without_names:
        started = anonymous(started)
    found = detect(recording)
    loose = None if recording.stations else _loose(run, recording.face_m2)
    return report(recording, started, found.as_json(), shown, Path(out_dir), loose)


def report(
    recording: Recording,
    started: RunStarted,
    finding: Mapping[str, Any],
    run_path: Path,
    out_dir: Path,
    loose: Station | None = None,
) -> Path:
    """As `write_report`, from what it reads; ``loose``: the samples of a run without stations."""
    finding = {
        "simulated": list(recording.simulated),
        "finish": recording.finish,
        **finding,
    }
    out_dir.mkdir(parents=True, exist_ok=True)
    with figures.style():
        if recording.stations:
            pictures, remarks = _pictures(recording, started, finding)
        else:
            pictures, remarks = _unjudged(loose, recording.face_m2)
        if recording.simulated:
            for one in pictures:
                figures.mark_simulated(one.figure)
        began = f"{started.started_utc[:16].replace('T', ' ')} UTC" if started.started_utc else ""
        title = ", ".join(filter(None, (f"Run {run_path.stem}", began)))
        text = page(title, finding, pictures, started.config, started.channels, remarks)
        for one in pictures:
            for ending in ("png", "svg", "pdf"):
                file = out_dir / f"{one.name}.{ending}"
                with naming(file):
                    one.figure.savefig(file, dpi=DPI, facecolor="white")
    path = out_dir / "report.html"
    with naming(path):
        path.write_text(text, encoding="utf-8")
    return path


def _loose(run: "Run", face_m2: float) -> Station | None:
    """All samples of the device that feels, in a station or not; None without any."""
    device = tactile_device(run.channels)
    blocks = [e.block for e in run.events() if isinstance(e, Samples) and e.device == device]
    time_s = np.concatenate([block.time_s for block in blocks] or [np.empty(0)])
    if not len(time_s):
        return None
    conversion = stress_conversion(run.channels[device], face_m2)
    signal_pa = conversion.stress_pa(np.concatenate([block.values for block in blocks]))
    unknown = np.full(len(time_s), np.nan)
    return Station(
        0, np.nan, np.nan, time_s, signal_pa, np.zeros(signal_pa.shape, bool),
        np.nan, np.nan, np.nan, unknown,
    )  # fmt: skip


def _unjudged(loose: Station | None, face_m2: float) -> tuple[list[Picture], list[str]]:
    """What there is of a run none of whose stations is complete."""
    remark = "No station is complete, so nothing is judged; `palpate resume` finishes a scan."
    if loose is None:
        return [], [f"{remark} There is no sample in it."]
    caption = "Force against time, of all that was recorded; none of it is judged."
    return [Picture("force", caption, figures.force_trace(loose, face_m2, "whole run"))], [remark]


def _pictures(
    recording: Recording, started: RunStarted, finding: Mapping[str, Any]
) -> tuple[list[Picture], list[str]]:
    best, why = figures.best_station(recording, finding)
    beats = finding.get("heart_rate_bpm")
    grid = figures.is_grid(recording)
    pictures, remarks = [], []
    if np.isfinite([s.x_m for s in recording.stations]).all():
        caption = "Contact stress of the hold at each station" + (
            ": its mean, and the mean beat's diastole and systole." if beats else "."
        )
        levels = figures.tactile_map(recording, beats)
        pictures.append(Picture("tactile_map", caption, levels))
        caption = "Pulse at each station" + (
            "; lines: what was found."
            if grid
            else ", with 95 % limits as bars; shaded: where the object lies."
        )
        if any(s["pulse_below_pa"] is not None for s in finding["stations"]):
            caption += " Triangles: none was seen there, and none " + (
                "is drawn." if grid else "larger can be (97.5 %)."
            )
        pictures.append(Picture("pulse_map", caption, figures.pulse_map(finding, recording)))
    place = place_words(best.x_m, best.y_m, in_grid=grid)
    pressed = f"station {best.index + 1} at {place}"
    caption = f"Force against time of {pressed}, {why}."
    trace = figures.force_trace(best, recording.face_m2, pressed)
    pictures.append(Picture("force", caption, trace))
    if steps := finding.get("steps"):
        caption = "Presses in steps: force against depth, and pulse against force with 95 % limits."
        pictures.append(Picture("steps", caption, figures.hold_down(steps)))
    if (image := taxels(recording, best, beats)) is not None:
        caption = f"The array in the hold of {pressed}, row 0 below; a triangle: no taxel is there."
        pictures.append(Picture("taxels", caption, image))
    scene = started.config.get("scene")
    if scene is not None:
        drawn = _section(Scene.model_validate(scene), best, started.config, place)
        if isinstance(drawn, Picture):
            pictures.append(drawn)
        else:
            remarks.append(drawn)
    return pictures, remarks


def _section(scene: Scene, best: Station, config: Mapping[str, Any], place: str) -> Picture | str:
    """The pressed section, or why there is none."""
    from sim_backend.models.press import (  # here: real runs need no finite elements
        CannotSolve,
        press,
    )
    from sim_backend.scene.slicing import section_at

    plan = config["plan"]
    deep_m = best.hold_depth_m if plan.get("force_n") else math.nan
    depth_mm = float(plan["indentation_mm"]) if math.isnan(deep_m) else round(1e3 * deep_m, 2)
    mmhg = scene.pulse.systolic_mmhg
    here = section_at(scene, 1e3 * best.y_m) if np.isfinite(best.y_m) else scene
    try:
        pressed = press(here, 1e3 * best.x_m, depth_mm, (mmhg,) if here.arteries else ())
    except CannotSolve as limit:
        return f"The section is not shown: {limit}"
    state = pressed.states[0]
    picture, solution = pressed.solved.picture, state.solution
    drawing = figures.section(
        picture.nodes_m,
        picture.displacement_m(solution),
        picture.triangles,
        picture.von_mises_pa(solution),
    )
    caption = f"SIMULATED section of {scene.name}, pressed {depth_mm:g} mm at {place}" + (
        f", {mmhg:g} mmHg in the lumen." if here.arteries else "."
    )
    return Picture("section", caption, drawing)
