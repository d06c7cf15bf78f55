"""The plane section of a scene that varies along the vessel: what lies under one row of a grid."""

from collections.abc import Callable

from sim_backend.scene.inclusion import Artery, Inclusion, Tumour
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.table import beyond_a_file


def section_at(scene: Scene, z_mm: float) -> Scene:
    """The scene cut at ``z_mm``; the same object if nothing varies along z.

    A vessel's ``path`` gives its interpolated centre (constant beyond its ends), a stenosis with
    ``z_mm`` lies only in that stretch, and a lump with ``z_mm`` is a sphere: its cut is a circle
    of radius sqrt(r^2 - dz^2), or nothing. A solid is not cut but moved by -``z_mm``, as it is
    pressed above z = 0. Raises `SceneError` beyond a solid's ends.
    """
    if scene.plane == "solid":
        return _moved_along(scene, -z_mm) if z_mm else scene
    cut = []
    for one in scene.inclusion:
        piece = _vessel(one, z_mm) if isinstance(one, Artery) else _lump(one, z_mm)
        if piece is not None:
            cut.append(piece)
    inclusion = tuple(cut)
    return (
        scene if inclusion == scene.inclusion else scene.model_copy(update={"inclusion": inclusion})
    )


def under_finger(scene: Scene) -> tuple[Inclusion, ...]:
    """The inclusions as a cut through the finger's middle shows them: of a solid those at z = 0."""
    if scene.plane != "solid":
        return scene.inclusion
    seen = [
        _vessel(one, 0.0)
        if isinstance(one, Artery)
        else _lump(one.model_copy(update={"z_mm": one.z_mm or 0.0}), 0.0)
        for one in scene.inclusion
    ]
    return tuple(one for one in seen if one is not None)


def images_along(scene: Scene) -> list[Scene]:
    """A solid, and the one seen with z turned round; of a section itself."""
    if scene.plane != "solid":
        return [scene]
    turned = _along(scene, lambda z: 0.0 - z)  # no -0.0, which a file would be named after
    return [_along(turned, lambda z: 0.0 - z), turned]


def is_symmetric_along(scene: Scene) -> bool:
    """Whether a solid is its own mirror image about z = 0, where it is pressed."""
    first, turned = images_along(scene)
    return first == turned


def _moved_along(scene: Scene, way_mm: float) -> Scene:
    moved = _along(scene, lambda z: round(z + way_mm, 9))
    tissue = moved.tissue
    assert tissue is not None and tissue.length_mm is not None  # the scene was checked
    if abs(tissue.z_mm or 0.0) >= tissue.length_mm / 2:
        middle_mm = (tissue.z_mm or 0.0) - way_mm
        raise SceneError(
            f"{scene.name}: a place lies at z = {-way_mm:g} mm, where the block has ended: "
            f"it reaches from {middle_mm - tissue.length_mm / 2:g} to "
            f"{middle_mm + tissue.length_mm / 2:g} mm"
        )
    return moved


def _along(scene: Scene, place: Callable[[float], float]) -> Scene:
    """A solid whose block, lumps, paths and stretches of stenosis are at ``place(z)``."""
    assert scene.tissue is not None  # the scene was checked
    inclusion: list[Tumour | Artery] = []
    for one in scene.inclusion:
        change: dict[str, object] = {}
        if isinstance(one, Tumour):
            change["z_mm"] = place(one.z_mm or 0.0)
        elif one.stenosis is not None and one.stenosis.z_mm is not None:
            ends = tuple(sorted(place(z) for z in one.stenosis.z_mm))
            change["stenosis"] = one.stenosis.model_copy(update={"z_mm": ends})
        if isinstance(one, Artery) and one.path:
            change["path"] = tuple(sorted((place(z), x, depth) for z, x, depth in one.path))
        inclusion.append(one.model_copy(update=change))
    tissue = scene.tissue.model_copy(update={"z_mm": place(scene.tissue.z_mm or 0.0)})
    return beyond_a_file(scene, {"tissue": tissue, "inclusion": tuple(inclusion)})


def _vessel(artery: Artery, z_mm: float) -> Artery:
    change: dict[str, object] = {}
    if artery.path:
        x_mm, depth_mm = artery.centre_mm(z_mm)
        change = {"x_mm": x_mm, "depth_mm": depth_mm, "path": ()}
    ring = artery.stenosis
    if ring is not None and ring.z_mm is not None:
        here = ring.z_mm[0] <= z_mm <= ring.z_mm[1]
        change["stenosis"] = ring.model_copy(update={"z_mm": None}) if here else None
    return artery.model_copy(update=change) if change else artery


def _lump(tumour: Tumour, z_mm: float) -> Tumour | None:
    if tumour.z_mm is None:
        return tumour
    square = (tumour.diameter_mm / 2) ** 2 - (z_mm - tumour.z_mm) ** 2
    if square <= 0:
        return None
    return tumour.model_copy(update={"diameter_mm": 2 * square**0.5, "z_mm": None})
