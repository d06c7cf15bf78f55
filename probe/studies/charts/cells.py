"""The cells of the stability atlas: families of presses that go where methods fail."""

import hashlib
import json
from copy import deepcopy
from dataclasses import asdict, dataclass
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
    def key(self) -> str:
        """A short hash of all of it: a cell that is changed has another."""
        text = json.dumps(asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    @property
    def single_element(self) -> bool:
        return self.how in {e for some in ELEMENTS.values() for e in some}


def cells() -> list[Cell]:
    """All of them, family by family."""
    return [*_poisson(), *_contrast(), *_wall(), *_depth(), *_collapse(), *_pressure(), *_cover(),
            *_edge(), *_finger(), *_loading(), *_small(), *_thin(), *_under_edge(), *_gap(),
            *_aside(), *_lone_depth(), *_inflation(), *_column(), *_bonded(), *_skin(),
            *_several(), *_locking()]  # fmt: skip


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
            for ratio in (0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 3000, 10000, 30000):
                raw = _scene(name, plane, modulus_kpa=50.0 * ratio)
                made.append(Cell("contrast", f"{name}, {plane}", f"{ratio:g}", raw,
                                 levels_mmhg=levels))  # fmt: skip
    return made


def _wall() -> list[Cell]:
    return [
        Cell("wall [mm]", plane, f"{wall:g}", _scene("TIHA", plane, wall_mm=wall), levels_mmhg=BEAT)
        for plane in PLANES
        for wall in (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.63, 1.0, 1.5)
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
        Cell("pressure [mmHg]", f"wall of {modulus:g} kPa", f"{p}",
             _scene("TIHA", modulus_kpa=modulus), levels_mmhg=(float(p),))
        for modulus in (15.0, 25.0, 50.0, 100.0, 400.0)
        for p in (20, 40, 60, 80, 100, 120, 160, 200, 250, 300, 400, 600)
    ]  # fmt: skip


def _cover() -> list[Cell]:
    made = []
    for name, radius, levels in (("TIT", 2.25, (0.0,)), ("TIHA", 2.88, BEAT)):
        for plane in PLANES:
            for cover in (0.003, 0.01, 0.03, 0.1, 0.3, 0.5, 0.8, 1.2, 2.0, 3.0):
                raw = _scene(name, plane, depth_mm=radius + cover)
                made.append(Cell("cover [mm]", f"{name}, {plane}", f"{cover:g}", raw,
                                 depth_mm=1.5, levels_mmhg=levels))  # fmt: skip
    return made


def _edge() -> list[Cell]:
    made = []
    for shape in ("cylinder", "flat"):
        for plane in PLANES:
            for x in (-3.0, -1.0, 0.0, 0.1, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0):
                raw = _scene("TI", plane)
                if shape == "flat":
                    raw["indenter"] = {"shape": "flat", "width_mm": 8.0, "edge_radius_mm": 1.0}
                made.append(Cell("finger at x [mm]", f"{shape}, {plane}", f"{x:g}", raw, x_mm=x))
    return made


def _finger() -> list[Cell]:
    made = []
    for shape in ("cylinder", "flat"):
        for plane in PLANES:
            for radius in (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0):
                raw = _scene("TIHA", plane)
                size = (
                    {"radius_mm": radius}
                    if shape == "cylinder"
                    else {"width_mm": 2 * radius, "edge_radius_mm": 0.25 * radius}
                )
                raw["indenter"] = {"shape": shape, **size, "length_mm": 10.0}
                made.append(Cell("finger's half width [mm]", f"{shape}, {plane}", f"{radius:g}",
                                 raw, depth_mm=min(2.5, radius), levels_mmhg=BEAT))  # fmt: skip
    return made


def _loading() -> list[Cell]:
    return [
        Cell("way of loading: depth [mm]", f"{how}, {plane}", f"{depth:g}", _scene("TIHA", plane),
             how, depth_mm=depth, levels_mmhg=(80.0,))
        for how in ("one step", "reversal")
        for plane in PLANES
        for depth in (0.2, 0.5, 1.0, 2.0, 2.5, 3.0, 4.0)
    ]  # fmt: skip


def _small() -> list[Cell]:
    return [
        Cell("small strain: depth [mm]", f"{name}, {plane}", f"{depth:g}", _scene(name, plane),
             "small", depth_mm=depth)
        for name in ("TI", "TIT")
        for plane in PLANES
        for depth in (0.02, 0.05, 0.1, 0.3, 0.6, 1.0, 1.6, 2.5, 4.0)
    ]  # fmt: skip


def _block(plane: str, height_mm: float, *inclusion: dict[str, Any]) -> dict[str, Any]:
    """A block of another height than TI's, with what lies in it."""
    raw = _scene("TI", plane)
    raw["tissue"]["height_mm"] = height_mm
    return raw | {"inclusion": list(inclusion)}


def _round(kind: str, x_mm: float, depth_mm: float, radius_mm: float, modulus_kpa: float = 400.0,
           poisson: float = 0.49) -> dict[str, Any]:  # fmt: skip
    """A lump, or a vessel whose wall is a fifth of its radius, as HAOT's is."""
    of_kind = (
        {"diameter_mm": 2 * radius_mm}
        if kind == "tumour"
        else {"inner_diameter_mm": 1.6 * radius_mm, "wall_mm": 0.2 * radius_mm}
    )
    place = {"x_mm": x_mm, "depth_mm": depth_mm, "modulus_kpa": modulus_kpa, "poisson": poisson}
    return {"kind": kind, **place, **of_kind}


def _thin() -> list[Cell]:
    return [
        Cell("height of the block [mm]", f"{what}, {pct} % deep, {plane}", f"{height:g}",
             _block(plane, height, *([] if what == "bare" else
                                     [_round(what, 32.0, 0.5 * height, 0.2 * height)])),
             "auto", depth_mm=0.01 * pct * height,
             levels_mmhg=BEAT if what == "artery" else (0.0,))
        for what, shares in (("bare", (5, 15, 30, 45)), ("tumour", (20,)), ("artery", (20,)))
        for pct in shares
        for plane in PLANES
        for height in (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 17.0)
    ]  # fmt: skip


def _under_edge() -> list[Cell]:
    """Wide fingers on thin blocks: what lies at their edge is near, and far from their middle."""
    made = []
    for what, levels in (("tumour", (0.0,)), ("artery", BEAT)):
        for width in (10.0, 20.0, 30.0):
            for plane in PLANES:
                for off in (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0):
                    raw = _block(plane, 6.0, _round(what, 32.0 + 0.5 * width + off, 3.0, 1.2))
                    raw["indenter"] = {"shape": "flat", "width_mm": width, "edge_radius_mm": 1.0}
                    made.append(Cell("off the finger's edge [mm]",
                                     f"{what}, {width:g} mm wide, {plane}", f"{off:g}", raw,
                                     "auto", depth_mm=0.8, levels_mmhg=levels))  # fmt: skip
    return made


def _gap() -> list[Cell]:
    made = []
    for what in ("lumps side by side", "lump over lump", "lump by vessel", "vessels side by side",
                 "lump and bottom", "vessel and bottom"):  # fmt: skip
        for plane in PLANES:
            for gap in (0.003, 0.01, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5):
                first = _round("artery" if what.startswith("vessel") else "tumour", 32.0, 5.0, 2.0)
                second = _round("artery" if "vessel" in what else "tumour", 36.0 + gap, 5.0, 2.0)
                if "over" in what:
                    second |= {"x_mm": 32.0, "depth_mm": 9.0 + gap}
                if "bottom" in what:
                    first["depth_mm"] = 8.0 - gap
                height = 10.0 if "bottom" in what else 14.0
                some = [first] if "bottom" in what else [first, second]
                made.append(Cell("gap [mm]", f"{what}, {plane}", f"{gap:g}",
                                 _block(plane, height, *some), depth_mm=1.5,
                                 levels_mmhg=BEAT if "vessel" in what else (0.0,)))  # fmt: skip
    return made


def _lone(name: str, contact: str, plane: str = "stress", **inclusion: Any) -> dict[str, Any]:
    return _scene(name, plane, **inclusion) | {"support": {"contact": contact}}


def _aside() -> list[Cell]:
    return [
        Cell("lone vessel, aside [mm]", f"{name}, {contact}, {depth:g} mm deep", f"{aside:g}",
             _lone(name, contact), x_mm=32.0 + aside, depth_mm=depth, levels_mmhg=BEAT)
        for name in ("HAOT", "SAOT")
        for contact in ("bonded", "frictionless")
        for depth in (0.5, 1.5)
        for aside in (0.0, 0.005, 0.05, 0.2, 0.5, 0.8, 1.1, 1.4, 2.0, 3.0)
    ]  # fmt: skip


def _lone_depth() -> list[Cell]:
    return [
        Cell("lone vessel: depth [mm]", f"{name}, {contact}, {plane}", f"{depth:g}",
             _lone(name, contact, plane), depth_mm=depth, levels_mmhg=BEAT)
        for name in ("HAOT", "SAOT")
        for contact in ("bonded", "frictionless")
        for plane in PLANES
        for depth in (0.05, 0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 2.5, 3.0)
    ]  # fmt: skip


def _inflation() -> list[Cell]:
    """Walls near the pressure at which they inflate without bound, pressed and not in the middle:
    beyond it nothing is stable."""
    return [
        Cell("lone vessel: pressure [mmHg]", f"{contact}, {modulus} kPa, {aside:g} mm aside",
             f"{p}",
             _lone("HAOT", contact, modulus_kpa=float(modulus)), x_mm=32.0 + aside,
             depth_mm=0.5, levels_mmhg=(float(p),))
        for contact in ("bonded", "frictionless")
        for modulus in (100, 200)
        for aside in (0.0, 1.0)
        for p in (20, 40, 60, 80, 90, 100, 120, 140, 160, 180, 200)
    ]  # fmt: skip


def _column() -> list[Cell]:
    """Narrow blocks 20 mm high under a wide flat finger, which buckle or bulge."""
    made = []
    for contact in ("bonded", "frictionless"):
        for pct in (2, 8, 20):
            for plane in PLANES:
                for width in (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 20.0):
                    raw = _block(plane, 20.0) | {"support": {"contact": contact}}
                    raw["tissue"]["width_mm"] = width
                    raw["indenter"] = {"shape": "flat", "width_mm": 2 * width,
                                       "edge_radius_mm": 1.0}  # fmt: skip
                    made.append(Cell("column's width [mm]", f"{contact}, {pct} % deep, {plane}",
                                     f"{width:g}", raw, x_mm=0.5 * width,
                                     depth_mm=0.2 * pct))  # fmt: skip
    return made


def _bonded() -> list[Cell]:
    made = []
    for name, levels in (("TI", (0.0,)), ("TIHA", BEAT)):
        for plane in PLANES:
            for depth in (0.1, 0.3, 0.6, 1.0, 1.5, 2.5, 4.0):
                raw = _scene(name, plane)
                raw["indenter"]["bonded"] = True
                made.append(Cell("bonded finger: depth [mm]", f"{name}, {plane}", f"{depth:g}", raw,
                                 depth_mm=depth, levels_mmhg=levels))  # fmt: skip
    return made


def _skin() -> list[Cell]:
    made = []
    for modulus in (10.0, 30.0, 100.0, 1000.0):
        for plane in PLANES:
            for thickness in (0.05, 0.1, 0.2, 0.4, 0.8, 1.25):
                raw = _scene("TIHA", plane)
                raw["indenter"]["skin"] = {"thickness_mm": thickness, "modulus_kpa": modulus}
                made.append(Cell("finger's skin [mm]", f"{modulus:g} kPa, {plane}",
                                 f"{thickness:g}", raw, levels_mmhg=BEAT))  # fmt: skip
    return made


def _several() -> list[Cell]:
    """A stiff, a soft and a stiff lump beside each other, or the other way round."""
    made = []
    for order in ("stiff, soft, stiff", "soft, stiff, soft"):
        for plane in PLANES:
            for ratio in (1, 3, 10, 30, 100, 300, 1000, 3000):
                moduli = [50.0 * ratio if one == "stiff" else 50.0 / ratio
                          for one in order.split(", ")]  # fmt: skip
                lumps = [_round("tumour", 28.0 + 4.0 * n, 5.0, 1.8, modulus)
                         for n, modulus in enumerate(moduli)]  # fmt: skip
                made.append(Cell("contrast of three", f"{order}, {plane}", f"{ratio}",
                                 _block(plane, 12.0, *lumps), depth_mm=2.0))  # fmt: skip
    return made


def _locking() -> list[Cell]:
    """Plane strain towards nu = 0.5: of the tissue, of what lies in it, or of both."""
    made = []
    for what, levels in (("tumour", (0.0,)), ("artery", BEAT)):
        for where in ("tissue", "inclusion", "both"):
            for nu in (0.45, 0.47, 0.49, 0.495, 0.498, 0.499, 0.4995, 0.4999, 0.49999):
                inner = 0.3 if where == "tissue" else nu
                raw = _block("strain", 10.0, _round(what, 32.0, 3.0, 2.0, poisson=inner),
                             _round("tumour", 37.0, 6.0, 2.0, 1000.0, inner))  # fmt: skip
                raw["tissue"]["poisson"] = 0.3 if where == "inclusion" else nu
                made.append(Cell("Poisson's ratio near 0.5", f"{what} and lump, {where}", f"{nu:g}",
                                 raw, depth_mm=1.5, levels_mmhg=levels))  # fmt: skip
    return made
