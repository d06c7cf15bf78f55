"""``palpate teach``: where the surface lies in a robot's base frame, from three touched points."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from probe.cli.say import Json, answer, answer_json, inform

if TYPE_CHECKING:  # commands import what they need when they run
    from drivers import Pose, Stage

POINTS = (
    "the scan's origin, on the surface",
    "a point along x, as far away as the scan is long",
    "a point to the left of that line, seen from the tool: the side of y",
)
DECIMALS_MM, DECIMALS_DEG, DECIMALS_RAD = 3, 4, 6


def teach(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="The rig with the arm.")],
    point: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y,Z", help="A point in mm of the robot's base; give three."),
    ] = None,
    write: Annotated[bool, typer.Option("--write", help="Write the keys into the file.")] = False,
    json: Json = False,
) -> None:
    """Find the mounting keys of an arm's rig by touching the surface at three points.

    Guide the tool to each by hand and press Enter, or type its numbers; the robot is only read.
    """
    import numpy as np

    from calibration.frame import frame_of, tool_in
    from drivers import ConfigError, WallClock
    from drivers.core.registry import settings_of
    from probe.config.devices import World, make_device
    from probe.config.load_rig import load_rig
    from probe.config.rig_text import as_keys, with_keys
    from probe.config.scan_plan import plan_for

    whole = load_rig(rig)
    if point and len(point) != len(POINTS):
        raise typer.BadParameter(f"{len(point)} --point given; a frame needs three")
    if "roll_deg" not in settings_of("stages", whole.stage.driver).model_fields:
        raise ConfigError(
            f"driver = {whole.stage.driver!r}: a frame is taught to an arm; jog to the scan's "
            "(0, 0) on the surface, and give what the stage reads there as origin_mm"
        )
    world = World(whole, plan_for(whole), WallClock())
    stage = make_device("stages", "stage", whole.stage, world, {})
    try:
        poses = [_numbers(one) for one in point] if point else _asked(stage)
    finally:
        stage.close()
    frame = frame_of(np.array([pose[:3] for pose in poses]))
    keys: dict[str, Any] = {
        "origin_mm": tuple(round(v, DECIMALS_MM) for v in frame.origin_mm),
        "roll_deg": round(frame.roll_deg, DECIMALS_DEG),
        "pitch_deg": round(frame.pitch_deg, DECIMALS_DEG),
        "yaw_deg": round(frame.yaw_deg, DECIMALS_DEG),
    }
    notes = [f"1 mm at one of the points would tilt the plane by {frame.tilt_per_mm_deg:.2f} "
             "degrees"]  # fmt: skip
    held = next((pose[3:] for pose in poses if len(pose) > 3), None)
    if held is not None:
        tool, tilt_deg = tool_in(frame, np.array(held))
        keys["tool_rotvec_rad"] = tuple(round(v, DECIMALS_RAD) for v in tool)
        notes.append(f"the tool stood {tilt_deg:.1f} degrees from the surface's normal")
    if write:
        rig.write_text(with_keys(rig.read_text("utf-8"), "stage", keys), encoding="utf-8")
        load_rig(rig)
    if json:
        answer_json({"stage": keys, "notes": notes, "written": str(rig) if write else None})
    else:
        answer(as_keys(keys))
        for note in notes:
            inform(note)
    inform(f"{'Written to' if write else 'These belong to [stage] of'} {rig}. Next: palpate scan "
           f"{rig} --dry-run, and a first scan in the air")  # fmt: skip


def _asked(stage: "Stage") -> "list[tuple[float, ...]]":
    """The three, each from the robot's present pose or as typed; in metres and rad."""
    found: list[tuple[float, ...]] = []
    for number, what in enumerate(POINTS, start=1):
        inform(f"Point {number}: {what}. Enter takes where the tool is; or type x, y, z in mm:")
        while len(found) < number:
            with suppress(typer.BadParameter):
                typed = _line()
                found.append(_numbers(typed) if typed else _present(stage))
                break
            inform("three numbers in mm of the robot's base, such as 412.5, -80, 96.2")
        x, y, z = (1e3 * v for v in found[-1][:3])
        inform(f"  {x:.2f}, {y:.2f}, {z:.2f} mm")
    return found


def _line() -> str:
    try:
        return input().strip()
    except EOFError:
        raise typer.Abort from None


def _present(stage: Any) -> "Pose":
    stage.connect()
    pose: Pose = stage.base_pose()
    return pose


def _numbers(text: str) -> tuple[float, ...]:
    """Three numbers in mm, in metres. Raises `typer.BadParameter`."""
    from probe.core.recording import FARTHEST_M

    try:
        x, y, z = (1e-3 * float(one) for one in text.replace(",", " ").split())
    except ValueError:
        raise typer.BadParameter(f"{text!r}: three numbers in mm are needed, as X,Y,Z") from None
    if not all(abs(one) <= FARTHEST_M for one in (x, y, z)):  # nor is not-a-number
        raise typer.BadParameter(f"{text!r}: up to {1e3 * FARTHEST_M:g} mm is what an arm reaches")
    return (x, y, z)
