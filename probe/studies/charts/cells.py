"""The cells of the stability atlas: families of presses that go where methods fail."""

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from sim_backend.scene.scene_file import load_scene

PLANES = ("stress", "strain")
ELEMENTS = {"stress": ("T6", "Q8R", "Q4", "Q4R"), "strain": ("T6", "T6M", "Q8R", "Q4M", "Q4R")}
BEAT = (80.0, 120.0)
HEIGHT_MM = 16.83


@dataclass(frozen=True)
class Cell:
    """One press. ``how``: ``auto``, ``finite`` or ``small`` as `press` takes them, a single
    element by name, ``one step``, or ``reversal`` (press, lift, press)."""

    family: str
    row: str
    value: str
    scene: dict[str, Any]
    how: str = "finite"
    x_mm: float = 32.0
    depth_mm: float = 2.5
    levels_mmhg: tuple[float, ...] = (0.0,)

    @property
    def single_element(self) -> bool:
        return self.how in {e for some in ELEMENTS.values() for e in some}


def cells() -> list[Cell]:
    """All of them, family by family."""
    return [*_poisson(), *_contrast(), *_wall(), *_depth(), *_collapse(), *_pressure(), *_cover(),
            *_edge(), *_finger(), *_loading(), *_small()]  # fmt: skip


def _scene(name: str, plane: str = "stress", **inclusion: Any) -> dict[str, Any]:
    raw = deepcopy(load_scene(name).model_dump(mode="json", exclude_none=True))
    raw["plane"] = plane
    for key, value in inclusion.items():
        raw["inclusion"][0][key] = value
    return raw


def _poisson() -> list[Cell]:
    made = []
    for plane in PLANES:
        for how in ("finite", *ELEMENTS[plane]):
            for nu in (0.3, 0.4, 0.45, 0.49, 0.495, 0.499, 0.4999, 0.49999):
                raw = _scene("TIHA", plane, poisson=nu)
                raw["tissue"]["poisson"] = nu
                made.append(Cell("Poisson's ratio", f"{plane}, {how}", f"{nu:g}", raw, how,
                                 levels_mmhg=BEAT))  # fmt: skip
    return made


def _contrast() -> list[Cell]:
    made = []
    for name, levels in (("TIT", (0.0,)), ("TIHA", BEAT)):
        for plane in PLANES:
            for ratio in (1, 3, 10, 30, 100, 300, 1000, 3000, 10000):
                raw = _scene(name, plane, modulus_kpa=50.0 * ratio)
                made.append(Cell("contrast", f"{name}, {plane}", f"{ratio}", raw,
                                 levels_mmhg=levels))  # fmt: skip
    return made


def _wall() -> list[Cell]:
    return [
        Cell("wall [mm]", plane, f"{wall:g}", _scene("TIHA", plane, wall_mm=wall), levels_mmhg=BEAT)
        for plane in PLANES
        for wall in (0.05, 0.1, 0.2, 0.4, 0.63, 1.0, 1.5)
    ]


def _depth() -> list[Cell]:
    return [
        Cell("depth [% of the block]", f"{name}, {plane}", f"{pct}", _scene(name, plane), "auto",
             depth_mm=0.01 * pct * HEIGHT_MM, levels_mmhg=levels)
        for name, levels in (("TI", (0.0,)), ("TIHA", BEAT))
        for plane in PLANES
        for pct in (2, 5, 10, 15, 20, 25, 30, 40, 50, 60, 70, 80)
    ]  # fmt: skip


def _collapse() -> list[Cell]:
    return [
        Cell("collapse: depth [mm]", f"wall of {modulus:g} kPa", f"{depth:g}",
             _scene("TIHA", modulus_kpa=modulus), depth_mm=depth, levels_mmhg=(10.0, 40.0))
        for modulus in (50.0, 100.0, 400.0)
        for depth in (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
    ]  # fmt: skip


def _pressure() -> list[Cell]:
    return [
        Cell("pressure [mmHg]", f"wall of {modulus:g} kPa", f"{p:g}",
             _scene("TIHA", modulus_kpa=modulus), levels_mmhg=(p,))
        for modulus in (25.0, 100.0, 400.0)
        for p in (40.0, 80.0, 120.0, 160.0, 200.0, 250.0, 300.0, 400.0)
    ]  # fmt: skip


def _cover() -> list[Cell]:
    made = []
    for name, radius, levels in (("TIT", 2.25, (0.0,)), ("TIHA", 2.88, BEAT)):
        for plane in PLANES:
            for cover in (0.3, 0.5, 0.8, 1.2, 2.0, 3.0):
                raw = _scene(name, plane, depth_mm=radius + cover)
                made.append(Cell("cover [mm]", f"{name}, {plane}", f"{cover:g}", raw,
                                 depth_mm=1.5, levels_mmhg=levels))  # fmt: skip
    return made


def _edge() -> list[Cell]:
    made = []
    for shape in ("cylinder", "flat"):
        for plane in PLANES:
            for x in (-3.0, -1.0, 0.0, 1.0, 2.0, 4.0, 6.0, 8.0):
                raw = _scene("TI", plane)
                if shape == "flat":
                    raw["indenter"] = {"shape": "flat", "width_mm": 8.0, "edge_radius_mm": 1.0}
                made.append(Cell("finger at x [mm]", f"{shape}, {plane}", f"{x:g}", raw, x_mm=x))
    return made


def _finger() -> list[Cell]:
    made = []
    for radius in (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0):
        for shape in ("cylinder", "flat"):
            raw = _scene("TIHA")
            size = (
                {"radius_mm": radius}
                if shape == "cylinder"
                else {"width_mm": 2 * radius, "edge_radius_mm": 0.25 * radius}
            )
            raw["indenter"] = {"shape": shape, **size, "length_mm": 10.0}
            made.append(Cell("finger's half width [mm]", shape, f"{radius:g}", raw,
                             depth_mm=min(2.5, radius), levels_mmhg=BEAT))  # fmt: skip
    return sorted(made, key=lambda cell: cell.row)


def _loading() -> list[Cell]:
    return [
        Cell("way of loading: depth [mm]", f"{how}, {plane}", f"{depth:g}", _scene("TIHA", plane),
             how, depth_mm=depth, levels_mmhg=(80.0,))
        for how in ("one step", "reversal")
        for plane in PLANES
        for depth in (0.5, 1.0, 2.5, 4.0)
    ]  # fmt: skip


def _small() -> list[Cell]:
    return [
        Cell("small strain: depth [mm]", f"{name}, {plane}", f"{depth:g}", _scene(name, plane),
             "small", depth_mm=depth)
        for name in ("TI", "TIT")
        for plane in PLANES
        for depth in (0.05, 0.1, 0.3, 1.0, 2.5, 4.0)
    ]  # fmt: skip
