"""The cells of the stability atlas: families of presses that go where methods fail."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any, NamedTuple

from sim_backend.scene.scene_file import load_scene

PLANES = ("stress", "strain")
ELEMENTS = {"stress": ("T6", "Q8R", "Q4", "Q4R"), "strain": ("T6", "T6M", "Q8R", "Q4M", "Q4R")}
EMPTY, BEAT = (0.0,), (80.0, 120.0)
LEVELS_MMHG = {"TI": EMPTY, "TIT": EMPTY, "TIHA": BEAT, "tumour": EMPTY, "artery": BEAT}
HEIGHT_MM = 16.83
SUPPORTS = ("bonded", "frictionless")

Raw = dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """One press. ``how``: ``auto``, ``finite`` or ``small`` as `press` takes them, a single
    element by name, ``one step``, or ``reversal`` (press, lift, press)."""

    family: str
    row: str
    value: str
    scene: Raw
    how: str = "finite"
    x_mm: float = 32.0
    depth_mm: float = 2.5
    levels_mmhg: tuple[float, ...] = EMPTY

    @property
    def key(self) -> str:
        """A short hash of all of it: a cell that is changed has another."""
        text = json.dumps(asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    @property
    def single_element(self) -> bool:
        return any(self.how in elements for elements in ELEMENTS.values())


class Family(NamedTuple):
    """``press`` gives a cell's scene and settings for each combination of ``axes``.

    An axis is named by what its values are, several of one axis with blanks between them; the last
    one goes along a row of the picture, and ``row`` names a row by the others.
    """

    name: str
    row: str
    axes: dict[str, Sequence[Any]]
    press: Callable[..., Raw]

    def cells(self) -> Iterator[Cell]:
        """Row by row."""
        names = " ".join(self.axes).split()
        for combination in product(*self.axes.values()):
            parts = (part if isinstance(part, tuple) else (part,) for part in combination)
            values = dict(zip(names, sum(parts, ()), strict=True))
            row, value = self.row.format(**values), f"{values[names[-1]]:g}"
            yield Cell(self.name, row, value, **self.press(**values))


def cells() -> list[Cell]:
    """All of them, family by family."""
    return [cell for family in FAMILIES for cell in family.cells()]


def _scene(
    name: str, plane: str = "stress", *, finger: Raw | None = None, whole_finger: Raw | None = None,
    **inclusion: Any,
) -> Raw:  # fmt: skip
    """A built-in scene with other values of its first inclusion, and of its finger."""
    raw: Raw = deepcopy(load_scene(name).model_dump(mode="json", exclude_none=True))
    raw["plane"] = plane
    raw["indenter"] = whole_finger or raw["indenter"] | (finger or {})
    if inclusion:
        raw["inclusion"][0] |= inclusion
    return raw


def _block(plane: str, height_mm: float, *inclusion: Raw, **other: Raw) -> Raw:
    """A block of another height than TI's, with what lies in it."""
    raw = _scene("TI", plane)
    raw["tissue"] |= {"height_mm": height_mm, **other.pop("tissue", {})}
    return raw | {"inclusion": list(inclusion), **other}


def _lone(name: str, contact: str, plane: str = "stress", **inclusion: Any) -> Raw:
    return _scene(name, plane, **inclusion) | {"support": {"contact": contact}}


def _round(kind: str, x_mm: float, depth_mm: float, radius_mm: float, modulus_kpa: float = 400.0,
           poisson: float = 0.49) -> Raw:  # fmt: skip
    """A lump, or a vessel whose wall is a fifth of its radius, as HAOT's is."""
    of_kind = (
        {"diameter_mm": 2 * radius_mm}
        if kind == "tumour"
        else {"inner_diameter_mm": 1.6 * radius_mm, "wall_mm": 0.2 * radius_mm}
    )
    place = {"x_mm": x_mm, "depth_mm": depth_mm, "modulus_kpa": modulus_kpa, "poisson": poisson}
    return {"kind": kind, **place, **of_kind}


def _flat(width_mm: float, edge_mm: float = 1.0) -> Raw:
    return {"shape": "flat", "width_mm": width_mm, "edge_radius_mm": edge_mm}


def _poisson(plane: str, how: str, nu: float) -> Raw:
    raw = _scene("TIHA", plane, poisson=nu)
    raw["tissue"]["poisson"] = nu
    return {"scene": raw, "how": how, "levels_mmhg": BEAT}


def _finger(shape: str, plane: str, radius: float) -> Raw:
    size = {"shape": shape, "radius_mm": radius}
    whole = {**(_flat(2 * radius, 0.25 * radius) if shape == "flat" else size), "length_mm": 10.0}
    scene = _scene("TIHA", plane, whole_finger=whole)
    return {"scene": scene, "depth_mm": min(2.5, radius), "levels_mmhg": BEAT}


def _thin(what: str, pct: int, plane: str, height: float) -> Raw:
    inclusion = [] if what == "bare" else [_round(what, 32.0, 0.5 * height, 0.2 * height)]
    return {"scene": _block(plane, height, *inclusion), "how": "auto",
            "depth_mm": 0.01 * pct * height,
            "levels_mmhg": LEVELS_MMHG.get(what, EMPTY)}  # fmt: skip


def _under_edge(what: str, width: float, plane: str, off: float) -> Raw:
    """Wide fingers on thin blocks: what lies at their edge is near, and far from their middle."""
    object_ = _round(what, 32.0 + 0.5 * width + off, 3.0, 1.2)
    return {"scene": _block(plane, 6.0, object_, indenter=_flat(width)), "how": "auto",
            "depth_mm": 0.8, "levels_mmhg": LEVELS_MMHG[what]}  # fmt: skip


def _gap(what: str, plane: str, gap: float) -> Raw:
    first = _round("artery" if what.startswith("vessel") else "tumour", 32.0, 5.0, 2.0)
    second = _round("artery" if "vessel" in what else "tumour", 36.0 + gap, 5.0, 2.0)
    if "over" in what:
        second |= {"x_mm": 32.0, "depth_mm": 9.0 + gap}
    if "bottom" in what:
        scene = _block(plane, 10.0, first | {"depth_mm": 8.0 - gap})
    else:
        scene = _block(plane, 14.0, first, second)
    return {"scene": scene, "depth_mm": 1.5, "levels_mmhg": BEAT if "vessel" in what else EMPTY}


def _several(order: str, plane: str, ratio: float) -> Raw:
    """A stiff, a soft and a stiff lump beside each other, or the other way round."""
    lumps = [_round("tumour", 28.0 + 4.0 * n, 5.0, 1.8, 50.0 * ratio if kind == "stiff"
                    else 50.0 / ratio) for n, kind in enumerate(order.split(", "))]  # fmt: skip
    return {"scene": _block(plane, 12.0, *lumps), "depth_mm": 2.0}


def _locking(what: str, where: str, nu: float) -> Raw:
    """Plane strain towards nu = 0.5: of the tissue, of what lies in it, or of both."""
    inner, outer = 0.3 if where == "tissue" else nu, 0.3 if where == "inclusion" else nu
    scene = _block("strain", 10.0, _round(what, 32.0, 3.0, 2.0, poisson=inner),
                   _round("tumour", 37.0, 6.0, 2.0, 1000.0, inner),
                   tissue={"poisson": outer})  # fmt: skip
    return {"scene": scene, "depth_mm": 1.5, "levels_mmhg": LEVELS_MMHG[what]}


FAMILIES = (
    Family("Poisson's ratio", "{plane}, {how}",
           {"plane how": [(p, how) for p in PLANES for how in ("finite", *ELEMENTS[p])],
            "nu": (0.3, 0.4, 0.45, 0.49, 0.495, 0.499, 0.4999, 0.49999)}, _poisson),
    Family("contrast", "{name}, {plane}",
           {"name": ("TIT", "TIHA"), "plane": PLANES,
            "ratio": (0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 3000, 10000, 30000)},
           lambda name, plane, ratio: {"scene": _scene(name, plane, modulus_kpa=50.0 * ratio),
                                       "levels_mmhg": LEVELS_MMHG[name]}),
    Family("wall [mm]", "{plane}",
           {"plane": PLANES, "wall": (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.63, 1.0, 1.5)},
           lambda plane, wall: {"scene": _scene("TIHA", plane, wall_mm=wall),
                                "levels_mmhg": BEAT}),
    Family("depth [% of the block]", "{name}, {plane}",
           {"name": ("TI", "TIHA"), "plane": PLANES,
            "pct": (2, 5, 10, 15, 20, 25, 30, 40, 50, 60, 70, 80)},
           lambda name, plane, pct: {"scene": _scene(name, plane), "how": "auto",
                                     "depth_mm": 0.01 * pct * HEIGHT_MM,
                                     "levels_mmhg": LEVELS_MMHG[name]}),
    Family("collapse: depth [mm]", "wall of {modulus:g} kPa",
           {"modulus": (50.0, 100.0, 400.0), "depth": (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)},
           lambda modulus, depth: {"scene": _scene("TIHA", modulus_kpa=modulus),
                                   "depth_mm": depth, "levels_mmhg": (10.0, 40.0)}),
    Family("pressure [mmHg]", "wall of {modulus:g} kPa",
           {"modulus": (15.0, 25.0, 50.0, 100.0, 400.0),
            "p": (20, 40, 60, 80, 100, 120, 160, 200, 250, 300, 400, 600)},
           lambda modulus, p: {"scene": _scene("TIHA", modulus_kpa=modulus),
                               "levels_mmhg": (float(p),)}),
    Family("cover [mm]", "{name}, {plane}",
           {"name radius": (("TIT", 2.25), ("TIHA", 2.88)), "plane": PLANES,
            "cover": (0.003, 0.01, 0.03, 0.1, 0.3, 0.5, 0.8, 1.2, 2.0, 3.0)},
           lambda name, radius, plane, cover: {
               "scene": _scene(name, plane, depth_mm=radius + cover), "depth_mm": 1.5,
               "levels_mmhg": LEVELS_MMHG[name]}),
    Family("finger at x [mm]", "{shape}, {plane}",
           {"shape": ("cylinder", "flat"), "plane": PLANES,
            "x": (-3.0, -1.0, 0.0, 0.1, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)},
           lambda shape, plane, x: {
               "scene": _scene("TI", plane, whole_finger=_flat(8.0) if shape == "flat" else None),
               "x_mm": x}),
    Family("finger's half width [mm]", "{shape}, {plane}",
           {"shape": ("cylinder", "flat"), "plane": PLANES,
            "radius": (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0)}, _finger),
    Family("way of loading: depth [mm]", "{how}, {plane}",
           {"how": ("one step", "reversal"), "plane": PLANES,
            "depth": (0.2, 0.5, 1.0, 2.0, 2.5, 3.0, 4.0)},
           lambda how, plane, depth: {"scene": _scene("TIHA", plane), "how": how,
                                      "depth_mm": depth, "levels_mmhg": (80.0,)}),
    Family("small strain: depth [mm]", "{name}, {plane}",
           {"name": ("TI", "TIT"), "plane": PLANES,
            "depth": (0.02, 0.05, 0.1, 0.3, 0.6, 1.0, 1.6, 2.5, 4.0)},
           lambda name, plane, depth: {"scene": _scene(name, plane), "how": "small",
                                       "depth_mm": depth}),
    Family("height of the block [mm]", "{what}, {pct} % deep, {plane}",
           {"what pct": (("bare", 5), ("bare", 15), ("bare", 30), ("bare", 45), ("tumour", 20),
                         ("artery", 20)), "plane": PLANES,
            "height": (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 17.0)}, _thin),
    Family("off the finger's edge [mm]", "{what}, {width:g} mm wide, {plane}",
           {"what": ("tumour", "artery"), "width": (10.0, 20.0, 30.0), "plane": PLANES,
            "off": (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0)}, _under_edge),
    Family("gap [mm]", "{what}, {plane}",
           {"what": ("lumps side by side", "lump over lump", "lump by vessel",
                     "vessels side by side", "lump and bottom", "vessel and bottom"),
            "plane": PLANES, "gap": (0.003, 0.01, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5)}, _gap),
    Family("lone vessel, aside [mm]", "{name}, {contact}, {depth:g} mm deep",
           {"name": ("HAOT", "SAOT"), "contact": SUPPORTS, "depth": (0.5, 1.5),
            "aside": (0.0, 0.005, 0.05, 0.2, 0.5, 0.8, 1.1, 1.4, 2.0, 3.0)},
           lambda name, contact, depth, aside: {
               "scene": _lone(name, contact), "x_mm": 32.0 + aside, "depth_mm": depth,
               "levels_mmhg": BEAT}),
    Family("lone vessel: depth [mm]", "{name}, {contact}, {plane}",
           {"name": ("HAOT", "SAOT"), "contact": SUPPORTS, "plane": PLANES,
            "depth": (0.05, 0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 2.5, 3.0)},
           lambda name, contact, plane, depth: {
               "scene": _lone(name, contact, plane), "depth_mm": depth, "levels_mmhg": BEAT}),
    # walls near the pressure at which they inflate without bound, pressed and not in the middle:
    # beyond it nothing is stable
    Family("lone vessel: pressure [mmHg]", "{contact}, {modulus} kPa, {aside:g} mm aside",
           {"contact": SUPPORTS, "modulus": (100, 200), "aside": (0.0, 1.0),
            "p": (20, 40, 60, 80, 90, 100, 120, 140, 160, 180, 200)},
           lambda contact, modulus, aside, p: {
               "scene": _lone("HAOT", contact, modulus_kpa=float(modulus)), "x_mm": 32.0 + aside,
               "depth_mm": 0.5, "levels_mmhg": (float(p),)}),
    # narrow blocks 20 mm high under a wide flat finger, which buckle or bulge
    Family("column's width [mm]", "{contact}, {pct} % deep, {plane}",
           {"contact": SUPPORTS, "pct": (2, 8, 20), "plane": PLANES,
            "width": (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 20.0)},
           lambda contact, pct, plane, width: {
               "scene": _block(plane, 20.0, support={"contact": contact},
                               tissue={"width_mm": width}, indenter=_flat(2 * width)),
               "x_mm": 0.5 * width, "depth_mm": 0.2 * pct}),
    Family("bonded finger: depth [mm]", "{name}, {plane}",
           {"name": ("TI", "TIHA"), "plane": PLANES,
            "depth": (0.1, 0.3, 0.6, 1.0, 1.5, 2.5, 4.0)},
           lambda name, plane, depth: {"scene": _scene(name, plane, finger={"bonded": True}),
                                       "depth_mm": depth, "levels_mmhg": LEVELS_MMHG[name]}),
    Family("finger's skin [mm]", "{modulus:g} kPa, {plane}",
           {"modulus": (10.0, 30.0, 100.0, 1000.0), "plane": PLANES,
            "thickness": (0.05, 0.1, 0.2, 0.4, 0.8, 1.25)},
           lambda modulus, plane, thickness: {
               "scene": _scene("TIHA", plane, finger={
                   "skin": {"thickness_mm": thickness, "modulus_kpa": modulus}}),
               "levels_mmhg": BEAT}),
    Family("contrast of three", "{order}, {plane}",
           {"order": ("stiff, soft, stiff", "soft, stiff, soft"), "plane": PLANES,
            "ratio": (1, 3, 10, 30, 100, 300, 1000, 3000)}, _several),
    Family("Poisson's ratio near 0.5", "{what} and lump, {where}",
           {"what": ("tumour", "artery"), "where": ("tissue", "inclusion", "both"),
            "nu": (0.45, 0.47, 0.49, 0.495, 0.498, 0.499, 0.4995, 0.4999, 0.49999)}, _locking),
)  # fmt: skip
