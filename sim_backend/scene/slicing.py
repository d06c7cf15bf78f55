"""The plane section of a scene that varies along the vessel: what lies under one row of a grid."""

import numpy as np

from sim_backend.scene.scene_file import Artery, Scene, SceneError, Tumour


def section_at(scene: Scene, z_mm: float) -> Scene:
    """The scene cut at ``z_mm``; the same object if nothing varies along z.

    A vessel's ``path`` gives its interpolated centre (held beyond its ends), a stenosis with
    ``z_mm`` lies only in that stretch, and a lump with ``z_mm`` is a sphere: its cut is a circle
    of radius sqrt(r^2 - dz^2), or nothing. A solid is not cut: it is pressed as a whole, above
    z = 0; elsewhere `SceneError`.
    """
    if scene.plane == "solid":
        if z_mm:
            raise SceneError(
                f"{scene.name} is a solid, which is scanned above z = 0 only, and a place lies at "
                f'{z_mm:g} mm: take one row there, or the scene with plane = "stress" or "strain"'
            )
        return scene
    cut = []
    for one in scene.inclusion:
        piece = _vessel(one, z_mm) if isinstance(one, Artery) else _lump(one, z_mm)
        if piece is not None:
            cut.append(piece)
    inclusion = tuple(cut)
    return (
        scene if inclusion == scene.inclusion else scene.model_copy(update={"inclusion": inclusion})
    )


def _vessel(artery: Artery, z_mm: float) -> Artery:
    change: dict[str, object] = {}
    if artery.path:
        z, x, depth = np.array(artery.path).T
        change = {
            "x_mm": float(np.interp(z_mm, z, x)),
            "depth_mm": float(np.interp(z_mm, z, depth)),
            "path": (),
        }
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
