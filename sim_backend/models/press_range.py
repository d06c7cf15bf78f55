"""Where, how deep and at which pressures a scene can be pressed."""

from math import inf
from numbers import Real

from sim_backend.scene.scene_file import Scene, SceneError

MOST_MMHG = 1000.0
"""Largest lumen pressure that can be meant: beyond it is a mistake of units."""
LEAST_SHARE = 1e-3
"""Least depth that can be meant, over the finger's width: metres written for millimetres are a
thousandth. At a thousandth of its finger of 10 mm TI answers 1.4 mN."""


def check_asked(
    scene: Scene,
    x_mm: float,
    depth_mm: float,
    pressures: tuple[float, ...],
    accuracy_pct: float,
) -> None:
    """Raises `SceneError` for a press, an accuracy or pressures that cannot be meant."""
    for key, value in {"x_mm": x_mm, "depth_mm": depth_mm}.items():
        if not isinstance(value, Real):
            raise SceneError(f"{key} = {value!r}: must be a number")
    if not 0.01 <= accuracy_pct <= 50:
        raise SceneError(f"accuracy = {accuracy_pct:g} %: must lie between 0.01 and 50")
    check_press(scene, x_mm, depth_mm)
    for p in pressures:
        if not 0 <= p <= MOST_MMHG:
            raise SceneError(f"pressure = {p:g} mmHg: must lie between 0 and {MOST_MMHG:g}")


def check_press(scene: Scene, x_mm: float, depth_mm: float) -> None:
    """Raises `SceneError` for a press that cannot be meant."""
    least_mm = LEAST_SHARE * scene.indenter.width_mm_projected
    if 0 < depth_mm < least_mm:
        raise SceneError(
            f"depth_mm = {depth_mm:g}: less than a thousandth of the finger's "
            f"{scene.indenter.width_mm_projected:g} mm; lengths are in mm. "
            + _in_metres(scene, x_mm, depth_mm)
        )
    if not 0 < depth_mm < scene.surface_mm:
        raise SceneError(
            f"depth_mm = {depth_mm:g}: must lie between 0 and the {scene.surface_mm:g} mm "
            f"of {scene.name}"
        )
    left, right = reach_mm(scene)
    if not left <= x_mm <= right:
        raise SceneError(f"x_mm = {x_mm:g}: the finger must stay between {left:g} and {right:g} mm")


def _in_metres(scene: Scene, x_mm: float, depth_mm: float) -> str:
    """What to do about numbers that may be metres."""
    left, right = reach_mm(scene)
    place = f"--x {1e3 * x_mm:g} " if x_mm and left <= 1e3 * x_mm <= right else ""
    if 1e3 * depth_mm < scene.surface_mm:
        return f"If you mean metres, write {place}--depth {1e3 * depth_mm:g}"
    return "Press deeper"


def reach_mm(scene: Scene) -> tuple[float, float]:
    """Where a press can begin: over the block, or over the middle half of a lone vessel."""
    if scene.tissue is not None:
        return 0.0, scene.tissue.width_mm
    one = scene.inclusion[0]
    return one.x_mm - one.outer_radius_mm / 2, one.x_mm + one.outer_radius_mm / 2


def along_mm(scene: Scene) -> tuple[float, float]:
    """From where to where along z a scene can be pressed: a solid up to its ends."""
    tissue = scene.tissue
    half_mm = ((tissue and tissue.length_mm) or inf) / 2
    middle_mm = (tissue and tissue.z_mm) or 0.0
    return middle_mm - half_mm, middle_mm + half_mm
