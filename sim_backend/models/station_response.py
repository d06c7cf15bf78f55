"""The answer at one place, for any depth and lumen pressure: kept, or solved once for all places
that are each other's mirror images.

Finite elements are imported only where one must be solved here.
"""

from dataclasses import replace

from sim_backend.models.response import Station, StationResponse
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.symmetry import alike
from sim_backend.scene.taxels import TaxelArray

MAX_KEPT = 256
"""Answers kept in memory, of a few hundred numbers each; the oldest goes first."""
_kept: dict[Station, StationResponse] = {}


def respond(
    scene: Scene, x_m: float, max_depth_m: float, array: TaxelArray | None = None
) -> StationResponse:
    """The answer of ``scene`` at ``x_m`` [m] down to ``max_depth_m`` [m], and if there is an
    ``array`` what each of its taxels takes of the force.

    A scene that is its own mirror image is solved on its left half only, a solid that is one along
    z on one side of it too. A solid takes up to a minute and is kept on disk. Raises
    `sim_backend.fem.newton.CannotSolve` where physics ends.
    """
    one = station(scene, x_m, max_depth_m, array)
    if one not in _kept:
        from sim_backend.models.stations import solved

        learn(one, solved(one))
    found = replace(_kept[one], x_m=x_m)
    if found.taxels is None:
        return found
    image = alike(scene, round(x_m, 9))
    return replace(found, taxels=found.taxels.seen_from(across=image.across, along=image.along))


def station(
    scene: Scene, x_m: float, max_depth_m: float, array: TaxelArray | None = None
) -> Station:
    """What `respond` solves for these arguments."""
    image = alike(scene, round(x_m, 9))
    return Station(image.scene, image.x_m, round(max_depth_m, 9), array)


def learn(one: Station, response: StationResponse) -> None:
    """Keep the answer of a station, whoever has solved it."""
    while len(_kept) >= MAX_KEPT:
        del _kept[next(iter(_kept))]
    _kept[one] = response


def is_known(one: Station) -> bool:
    """Whether `respond` has the answer without solving anything."""
    return one in _kept or all(path.exists() for _, path in one.parts)
