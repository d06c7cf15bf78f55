"""Presses that leave little of a vessel's lumen."""

import numpy as np

from sim_backend.scene.scene_file import Scene


def drawn(case: int) -> tuple[Scene, float, float]:
    """A scene, and where [m] and how deep [m] it is pressed."""
    rng = np.random.default_rng([11, case])
    poisson, height = float(rng.choice([0.45, 0.49])), rng.uniform(12, 20)
    radius = rng.uniform(1.5, 3.5)
    finger: dict[str, object] = {"shape": "cylinder", "radius_mm": rng.uniform(3, 7)}
    if rng.random() > 0.7:
        finger = {"shape": "flat", "width_mm": rng.uniform(5, 10), "edge_radius_mm": 1.0}
    wall = radius * rng.uniform(0.12, 0.35)
    vessel = {
        "kind": "artery", "x_mm": 32.0, "inner_diameter_mm": 2 * (radius - wall), "wall_mm": wall,
        "depth_mm": radius + (height - 2 * radius) * rng.uniform(0.4, 0.9), "poisson": poisson,
        "modulus_kpa": 150 * (1000 / 150) ** rng.random(),
    }  # fmt: skip
    scene = Scene.model_validate({
        "name": f"flat {case}", "plane": str(rng.choice(["stress", "strain"])),
        "tissue": {"width_mm": 64.0, "height_mm": height, "modulus_kpa": 20 * 4 ** rng.random(),
                   "poisson": poisson},
        "inclusion": [vessel], "indenter": finger | {"length_mm": 10.0},
    })  # fmt: skip
    x_mm = 32.0 + float(rng.choice([0.0, rng.uniform(-2, 2)]))
    return scene, 1e-3 * x_mm, 1e-3 * height * rng.uniform(0.25, 0.5)
