"""Which presses are each other's mirror images, and which blocks stand for one that is not."""

from typing import NamedTuple

from sim_backend.scene.inclusion import Artery
from sim_backend.scene.scene_file import Scene, mirrored
from sim_backend.scene.slicing import images_along


class Image(NamedTuple):
    """A scene and place [m], seen from the other side ``across`` the vessels, ``along`` them, both
    or neither."""

    scene: Scene
    x_m: float
    across: bool
    along: bool


def alike(scene: Scene, x_m: float) -> Image:
    """One scene and place of all that are each other's mirror images: the left one, and along a
    solid the one at larger z."""
    along = list(enumerate(images_along(scene)))
    places = [Image(image, x_m, False, bool(turned)) for turned, image in along]
    if scene.tissue is not None:
        across_m = round(1e-3 * scene.tissue.width_mm - x_m, 9)
        places += [Image(mirrored(image), across_m, True, bool(turned)) for turned, image in along]
    first = min((_z_mm(image.scene), image.x_m) for image in places)
    leftmost = [image for image in places if (_z_mm(image.scene), image.x_m) == first]
    return min(leftmost, key=lambda image: image.scene.model_dump_json())


def _z_mm(scene: Scene) -> float:
    return (scene.tissue and scene.tissue.z_mm) or 0.0


def symmetric_parts(scene: Scene) -> list[Scene]:
    """The blocks whose mean is the answer: two for a straight solid beside its middle, up to where
    an end comes under the finger; else the scene itself."""
    tissue, aside_mm = scene.tissue, abs(_z_mm(scene))
    if aside_mm == 0.0 or not is_straight(scene):
        return [scene]
    assert tissue is not None and tissue.length_mm is not None  # what lies aside is a solid
    near_mm = tissue.length_mm / 2 - aside_mm
    if near_mm < scene.indenter.breadth_mm_projected / 2:
        return [scene]
    return [
        scene.model_copy(update={"tissue": tissue.model_copy(
            update={"length_mm": round(2 * end_mm, 9), "z_mm": None})})
        for end_mm in (near_mm, near_mm + 2 * aside_mm)
    ]  # fmt: skip


def is_straight(scene: Scene) -> bool:
    """Whether nothing but the block's ends varies along z."""
    return all(
        isinstance(one, Artery)
        and not one.path
        and (one.stenosis is None or one.stenosis.z_mm is None)
        for one in scene.inclusion
    )
