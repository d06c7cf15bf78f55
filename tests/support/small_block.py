"""A narrow block over a vessel, mirrored: solved in a moment."""

from sim_backend import Scene

BLOCK = Scene.model_validate({
    "name": "small block", "plane": "stress",
    "tissue": {"width_mm": 24.0, "height_mm": 10.0, "modulus_kpa": 50.0, "poisson": 0.49},
    "inclusion": [{"kind": "artery", "x_mm": 12.0, "depth_mm": 5.0, "inner_diameter_mm": 3.0,
                   "wall_mm": 0.6, "modulus_kpa": 400.0, "poisson": 0.49}],
    "indenter": {"shape": "cylinder", "radius_mm": 4.0, "length_mm": 10.0},
    "pulse": {"wave": "paper", "rate_bpm": 72.0},
})  # fmt: skip
