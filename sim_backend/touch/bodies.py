"""Bodies of a scene as a touch table has them, and back: in units of finger and tissue."""

from typing import Any

import numpy as np

from sim_backend.arrays import Array
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG
from sim_backend.touch.kinds import LUMP, VESSEL, Kind
from sim_backend.touch.table import block_of

NO_PLAQUE = 2.0
"""Modulus of a plaque that is not there, over the wall's: any will do."""


class Units:
    """Of the finger and the tissue of a ``block``: what a table's numbers are over."""

    def __init__(self, block: Scene) -> None:
        assert block.tissue is not None
        self.block, self.modulus_kpa = block, block.tissue.modulus_kpa
        self.length_mm = block.indenter.width_mm_projected / 2
        self.force_n_per_m = 1e3 * self.modulus_kpa * 1e-3 * self.length_mm
        self._pressure_mmhg = 1e3 * self.modulus_kpa / PA_PER_MMHG

    def place_mm(self, x: float, theta: Array) -> float:
        """From the block's side on."""
        return float((np.exp(theta[-1]) + x) * self.length_mm)

    def parameters(self, body: Any) -> tuple[Kind, Array]:
        """An inclusion's kind and parameters (p,)."""
        tissue, pulse, length_mm = self.block.tissue, self.block.pulse, self.length_mm
        assert tissue is not None
        place = (body.x_mm - tissue.width_mm / 2) / length_mm, body.depth_mm / length_mm
        log_ratio = np.log(body.modulus_kpa / self.modulus_kpa)
        block = block_of(self.block)
        if not isinstance(body, Artery):
            return LUMP, np.array([*place, np.log(body.diameter_mm / length_mm), log_ratio, *block])
        plaque = body.stenosis.modulus_kpa / body.modulus_kpa if body.stenosis else NO_PLAQUE
        return VESSEL, np.array([
            *place, np.log(body.inner_diameter_mm / length_mm),
            np.log(body.wall_mm / body.inner_diameter_mm), log_ratio,
            np.log(pulse.diastolic_mmhg / self._pressure_mmhg),
            pulse.systolic_mmhg / pulse.diastolic_mmhg - 1,
            body.stenosis.fraction if body.stenosis else 0.0, np.log(plaque), *block,
        ])  # fmt: skip

    def scene(self, *bodies: tuple[Kind, Array]) -> Scene:
        """A block with bodies in it, as high and wide as the last one's parameters say; pressures
        are the wave's ends. Raises ValueError where they have no room."""
        file = self.block.model_dump(exclude_none=True) | {"inclusion": []}
        tissue = file["tissue"]
        for kind, theta in bodies:
            of = dict(zip(kind.parameters, (float(value) for value in theta), strict=True))
            tissue["height_mm"] = np.exp(of["log_height"]) * self.length_mm
            tissue["width_mm"] = 2 * np.exp(of["log_half_width"]) * self.length_mm
            if "x" in of:
                body = {
                    "x_mm": self.place_mm(of["x"], theta), "depth_mm": of["depth"] * self.length_mm,
                    "modulus_kpa": np.exp(of["log_ratio"]) * self.modulus_kpa,
                    "poisson": tissue["poisson"],
                }  # fmt: skip
                file["inclusion"].append(
                    body | (self._vessel(of) if kind.beats else self._lump(of))
                )
            if kind.beats:
                diastolic_mmhg = np.exp(of["log_pressure"]) * self._pressure_mmhg
                file["pulse"] = {
                    "diastolic_mmhg": diastolic_mmhg,
                    "systolic_mmhg": diastolic_mmhg * (1 + of["swing"]),
                }
        return Scene.model_validate(file)

    def _lump(self, of: dict[str, float]) -> dict[str, Any]:
        return {"kind": "tumour", "diameter_mm": np.exp(of["log_diameter"]) * self.length_mm}

    def _vessel(self, of: dict[str, float]) -> dict[str, Any]:
        inner_mm = np.exp(of["log_inner"]) * self.length_mm
        wall_kpa = np.exp(of["log_ratio"]) * self.modulus_kpa
        narrowing = {
            "fraction": of["narrowing"],
            "modulus_kpa": np.exp(of["log_plaque"]) * wall_kpa,
        }
        return {
            "kind": "artery", "inner_diameter_mm": inner_mm,
            "wall_mm": np.exp(of["log_wall"]) * inner_mm,
            **({"stenosis": narrowing} if of["narrowing"] > 0 else {}),
        }  # fmt: skip
