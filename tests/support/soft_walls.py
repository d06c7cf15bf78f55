"""Scenes whose vessel nearly bursts."""

from sim_backend.scene.scene_file import Scene, load_scene


def soft_walled(systolic_mmhg: float, tissue_kpa: float, **wall: float) -> Scene:
    scene = load_scene("TIHA")
    assert scene.tissue is not None
    return scene.model_copy(update={
        "tissue": scene.tissue.model_copy(update={"modulus_kpa": tissue_kpa}),
        "inclusion": (scene.inclusion[0].model_copy(update=wall),),
        "pulse": scene.pulse.model_copy(update={"systolic_mmhg": systolic_mmhg}),
    })  # fmt: skip
