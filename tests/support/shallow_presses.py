"""A bare block for presses so shallow that few nodes touch."""

from sim_backend.scene.scene_file import Scene

WIDTH_MM, HEIGHT_MM = 64.0, 16.83


def scene_of(model: str, radius_mm: float) -> Scene:
    """A bare block under a cylinder, or under a ball in three dimensions."""
    tissue = {"width_mm": WIDTH_MM, "height_mm": HEIGHT_MM, "modulus_kpa": 50.0, "poisson": 0.45}
    plane, finger = "strain", "cylinder"
    if model == "axisymmetric":
        plane, finger, tissue = "solid", "sphere", tissue | {"length_mm": WIDTH_MM}
    finger_of = {"shape": finger, "radius_mm": radius_mm}
    return Scene.model_validate(
        {"name": "shallow", "plane": plane, "tissue": tissue, "indenter": finger_of}
    )
