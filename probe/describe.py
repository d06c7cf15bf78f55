"""Everything that is needed to know what a run's samples mean, as JSON-able values."""

import platform
from importlib.metadata import version
from typing import Any

from probe.plan import Plan
from probe.rig import Rig
from sim_backend.scene import Scene

LIBRARIES = ("palpate", "numpy", "scipy")


def run_config(rig: Rig, scene: Scene | None, plan: Plan, seed: int) -> dict[str, Any]:
    """The ``config`` of `RunStarted`.

    ``face_mm2`` is the rig's, or the indenter's of a simulated scene, or None if neither is known.
    """
    face_mm2 = rig.face_mm2 or (scene.face_mm2 if scene is not None else None)
    return {
        "rig": rig.model_dump(mode="json"),
        "scene": None if scene is None else scene.model_dump(mode="json"),
        "plan": {
            "stations": [[p.index, 1e3 * p.x_m, 1e3 * p.y_m] for p in plan.places],
            "columns": ["index", "x_mm", "y_mm"],
            "surface_mm": [1e3 * plan.surface(p.x_m, p.y_m) for p in plan.places],
            "travel_z_mm": 1e3 * plan.travel_z_m,
            "indentation_mm": 1e3 * plan.indentation_m,
            "ramp_s": plan.ramp_s,
            "hold_s": plan.hold_s,
        },
        "calibration": dict(rig.calibration),
        "versions": {name: version(name) for name in LIBRARIES}
        | {"python": platform.python_version()},
        "seed": seed,
        "face_mm2": face_mm2,
    }
