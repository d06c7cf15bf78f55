"""The answer at one place, for any depth and lumen pressure: kept, or solved once for all places
that are each other's mirror images.

Finite elements are imported only where one must be solved here.
"""

from dataclasses import replace
from typing import NamedTuple

from sim_backend.models.response import StationResponse
from sim_backend.scene.scene_file import Scene, mirrored
from sim_backend.scene.slicing import mirrored_along

MAX_KEPT = 256
"""Answers kept in memory, of a few hundred numbers each; the oldest goes first."""


class Station(NamedTuple):
    """What is solved: a place [m] of a scene down to a depth [m]. Of places that are each other's
    mirror images it is the left one, and along a solid the one at larger z."""

    scene: Scene
    x_m: float
    max_depth_m: float


_kept: dict[Station, StationResponse] = {}


def respond(scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
    """The answer of ``scene`` at ``x_m`` [m] down to ``max_depth_m`` [m].

    A scene that is its own mirror image is solved on its left half only, a solid that is one along
    z on one side of it too. A solid takes up to a minute and is kept on disk. Raises
    `sim_backend.fem.newton.CannotSolve` where physics ends.
    """
    one = station(scene, x_m, max_depth_m)
    found = _kept.get(one)
    if found is None:
        found = _solved(*one)
        learn(one, found)
    return replace(found, x_m=x_m)


def station(scene: Scene, x_m: float, max_depth_m: float) -> Station:
    """What `respond` solves for these arguments."""
    half_m = round(x_m, 9)
    if scene.plane == "solid":
        scene, half_m = _alike(scene, half_m)
    elif scene.tissue is not None and mirrored(scene) == scene:
        width = 1e-3 * scene.tissue.width_mm
        half_m = round(min(half_m, width - half_m), 9)
    return Station(scene, half_m, round(max_depth_m, 9))


def _alike(scene: Scene, x_m: float) -> tuple[Scene, float]:
    """One solid and place of the four that are each other's mirror images."""
    assert scene.tissue is not None  # the scene was checked
    across_m = round(1e-3 * scene.tissue.width_mm - x_m, 9)
    turned = mirrored_along(scene)
    along = [mirrored_along(turned), turned]
    four = [(one, x_m) for one in along] + [(mirrored(one), across_m) for one in along]
    leftmost = min(four, key=lambda one: (_z_mm(one[0]), one[1]))
    alike = [one for one in four if (_z_mm(one[0]), one[1]) == (_z_mm(leftmost[0]), leftmost[1])]
    return min(alike, key=lambda one: one[0].model_dump_json())


def _z_mm(scene: Scene) -> float:
    return (scene.tissue and scene.tissue.z_mm) or 0.0


def learn(one: Station, response: StationResponse) -> None:
    """Keep the answer of a station, whoever has solved it."""
    while len(_kept) >= MAX_KEPT:
        del _kept[next(iter(_kept))]
    _kept[one] = response


def is_known(one: Station) -> bool:
    """Whether `respond` has the answer without solving anything."""
    if one in _kept or one.scene.plane != "solid":
        return one in _kept
    from sim_backend.models.solid_response import is_kept

    return is_kept(*one)


def _solved(scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
    if scene.plane == "solid":
        from sim_backend.models.solid_response import respond_solid as solved
    else:
        from sim_backend.models.plane_response import respond_plane as solved
    return solved(scene, x_m, max_depth_m)
