"""The scene file: what lies in the phantom, how it is pressed and how it beats.

Keys carry their units (``depth_mm``, ``modulus_kpa``); ``depth_mm`` is from the surface to a
centre. Impossible geometry is refused with the key, the value and what is allowed.
"""

from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from drivers.core.files import FileRefused, parse_toml, path_of, read_file
from sim_backend import html
from sim_backend.scene.explain import Explained, explain
from sim_backend.scene.inclusion import Artery, Inclusion, Poisson
from sim_backend.scene.indenter import AnyIndenter, Cylinder
from sim_backend.scene.room import need_room
from sim_backend.scene.table import Positive, Table, is_unset

MAX_FILE_BYTES = 1_000_000
MAX_NAME = 100  # characters
MOST_OBLIQUE_DEG = 45.0
"""Of a solid's vessel to z."""
LEAST_STRETCH = 0.02
"""Of a solid's stenosis within its block, over its vessel's outer radius: twice the thinnest layer
that is made (`sim_backend.fem.solid.build.LEAST_LAYER`). One of 0.1 um ended in words of no
equilibrium."""
WAVES = ("paper", "brachial")


class SceneError(ValueError):
    """A scene that cannot be: the text names file, key, value and what is allowed.

    Examples
    --------
    >>> import palpate
    >>> palpate.load_scene("TIHB")
    Traceback (most recent call last):
    sim_backend.scene.scene_file.SceneError: TIHB: neither a file nor a built-in scene (HAOT, ...
    """


class Tissue(Table):
    """The block; ``relaxation`` is a Prony series of [weight, tau_s] pairs of the stiffness.

    A solid reaches ``length_mm`` / 2 to either side of ``z_mm`` (0 if not given); its ``ends`` are
    free, or held along z as by neighbouring tissue. It is pressed above z = 0.
    """

    width_mm: Positive
    height_mm: Positive
    length_mm: Annotated[Positive | None, Field(exclude_if=is_unset)] = None
    z_mm: Annotated[float | None, Field(exclude_if=is_unset)] = None
    ends: Annotated[Literal["free", "held"] | None, Field(exclude_if=is_unset)] = None
    modulus_kpa: Positive
    poisson: Poisson
    relaxation: tuple[tuple[float, Positive], ...] = ()

    @field_validator("relaxation")
    @classmethod
    def _weights(cls, pairs: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if any(g <= 0 for g, _ in pairs) or sum(g for g, _ in pairs) >= 1:
            raise ValueError("weights must be positive and sum to less than 1")
        return pairs


class Support(Table):
    """What the body rests on: rigid, flat, frictionless unless it is ``bonded``.

    A block's bottom is held in the direction of compression, as in the paper, also where it would
    lift; with ``lifts`` it may, except right under the finger.
    """

    contact: Literal["bonded", "frictionless"] | None = None
    lifts: bool = False


class Pulse(Table):
    """How the lumen's pressure beats.

    ``wave``: ``paper``, ``brachial`` or a CSV file (columns time_s, pressure_mmhg).
    ``start``: ``hold`` starts the beat with the hold, as the paper does (until then the lumen
    rests at the wave's first value); ``free`` beats all the time.
    """

    wave: str = "paper"
    rate_bpm: Annotated[float, Field(ge=20, le=300)] = 60 / 0.825
    systolic_mmhg: Annotated[float, Field(gt=0, le=400)] = 120.0
    diastolic_mmhg: Annotated[float, Field(ge=0, le=400)] = 80.0
    start: Literal["hold", "free"] = "hold"

    @model_validator(mode="after")
    def _levels(self) -> Self:
        if self.systolic_mmhg <= self.diastolic_mmhg:
            raise ValueError(
                f"systolic_mmhg = {self.systolic_mmhg:g} must be above "
                f"diastolic_mmhg = {self.diastolic_mmhg:g}"
            )
        return self


def _one_line(name: str) -> str:
    """A name is printed, and begins the names of run files."""
    if not 0 < len(name) <= MAX_NAME or not name.isprintable() or "/" in name or "\\" in name:
        raise ValueError(f"at most {MAX_NAME} printable characters, no slashes")
    return name


class Scene(Explained, Table):
    """A whole scene. Without ``tissue`` the one artery stands alone on a rigid flat support."""

    refusal: ClassVar = SceneError
    beyond: ClassVar = (
        "; layers, other material laws, friction and ellipses are not modelled "
        '(docs/reference/scene-file.md, "What is not modelled")'
    )
    name: Annotated[str, AfterValidator(_one_line)]
    plane: Literal["stress", "strain", "solid"] = "stress"
    tissue: Tissue | None = None
    inclusion: tuple[Inclusion, ...] = ()
    indenter: AnyIndenter = Cylinder()
    support: Support = Support()
    pulse: Pulse = Pulse()

    @property
    def surface_mm(self) -> float:
        """Height of the untouched surface above the support."""
        if self.tissue is not None:
            return self.tissue.height_mm
        return 2 * self.inclusion[0].outer_radius_mm

    def _repr_html_(self) -> str:
        """A table and a picture to scale, for notebooks."""
        what = [("plane", self.plane), ("finger", self.indenter.shape), ("wave", self.pulse.wave)]
        what += [
            (one.kind, f"x {one.x_mm:g} mm, depth {one.depth_mm:g} mm, {one.modulus_kpa:g} kPa")
            for one in self.inclusion
        ]
        width_mm = self.tissue.width_mm if self.tissue else 2 * self.inclusion[0].x_mm
        circles = [(i.x_mm, i.depth_mm, i.outer_radius_mm, i.kind) for i in self.inclusion]
        picture = html.section(width_mm, self.surface_mm, circles)
        return f"<b>{html.escape(self.name)}</b>" + html.table(what) + picture

    @property
    def arteries(self) -> tuple[Artery, ...]:
        return tuple(i for i in self.inclusion if isinstance(i, Artery))

    @property
    def bonded_support(self) -> bool:
        """Whether what rests on the support sticks to it: by default a lone vessel does."""
        contact = self.support.contact
        return self.tissue is None if contact is None else contact == "bonded"

    @property
    def face_mm2(self) -> float:
        """The indenter's projected area, the default face of the tactile signal."""
        return self.indenter.face_mm2

    def need_section(self, what: str) -> None:
        """Raises `SceneError` for a solid, of which ``what`` knows nothing."""
        if self.plane == "solid":
            raise SceneError(
                f"{self.name} is a solid, and {what} plane sections only: take palpate press "
                'alone, or the scene with plane = "stress" or "strain", without length_mm'
            )

    @model_validator(mode="after")
    def _dimensions(self) -> Self:
        if self.plane == "solid":
            _need_solid(self)
        else:
            _need_plane(self)
        return self

    @model_validator(mode="after")
    def _geometry(self) -> Self:
        if self.tissue is None:
            if len(self.inclusion) != 1 or not isinstance(self.inclusion[0], Artery):
                raise ValueError("without a [tissue] table there must be exactly one artery")
            if self.support.lifts:
                raise ValueError("support.lifts = true: a block's; a lone vessel lifts by itself")
            return self
        need_room(
            self.inclusion,
            self.tissue.width_mm,
            self.tissue.height_mm,
            solid=self.plane == "solid",
        )
        return self


def _need_plane(scene: Scene) -> None:
    """Keys that only a solid has are refused in a plane scene."""
    checked = {
        "tissue.length_mm": scene.tissue and scene.tissue.length_mm,
        "tissue.z_mm": scene.tissue and scene.tissue.z_mm,
        "tissue.ends": scene.tissue and scene.tissue.ends,
        **{f"indenter.{key}": value for key, value in scene.indenter.only_in_a_solid().items()},
    }
    for key, value in checked.items():
        if value is not None:
            raise ValueError(
                f'{key} = {value}: only with plane = "solid"; this scene is plane = {scene.plane!r}'
            )


def _need_solid(scene: Scene) -> None:
    if scene.tissue is None:
        raise ValueError('plane = "solid" needs a [tissue] table: a lone vessel is plane')
    if scene.tissue.length_mm is None:
        raise ValueError('tissue.length_mm is missing: plane = "solid" needs the block\'s length')
    scene.indenter.need_solid()
    if scene.support.lifts:
        raise ValueError(
            "support.lifts = true: in plane scenes only; a solid's bottom is held down"
        )
    half_mm, middle_mm = scene.tissue.length_mm / 2, scene.tissue.z_mm or 0.0
    if abs(middle_mm) >= half_mm:
        raise ValueError(
            f"tissue.z_mm = {middle_mm:g}: the block must lie under the finger, at z = 0; "
            f"it must stay within half of length_mm, {half_mm:g}, of 0"
        )
    for n, one in enumerate(scene.inclusion):
        if isinstance(one, Artery):
            _need_stretch_within(one, f"inclusion[{n}]", middle_mm - half_mm, middle_mm + half_mm)
            _need_course_along(one, f"inclusion[{n}]")
            continue
        room_mm = half_mm - one.outer_radius_mm
        if abs((one.z_mm or 0.0) - middle_mm) >= room_mm:
            raise ValueError(
                f"inclusion[{n}] (tumour): z_mm = {one.z_mm or 0:g} breaks an end; "
                f"it must stay within {room_mm:g} of {middle_mm:g}"
            )


def _need_stretch_within(one: Artery, key: str, low_mm: float, high_mm: float) -> None:
    """A stenosis that lies beyond the block's ends would be no stenosis at all, nor a thinner one
    than can be meshed."""
    stretch = one.stenosis.z_mm if one.stenosis is not None else None
    if stretch is None:
        return
    said = f"{key}.stenosis: z_mm = [{stretch[0]:g}, {stretch[1]:g}]"
    within_mm = min(stretch[1], high_mm) - max(stretch[0], low_mm)
    least_mm = LEAST_STRETCH * one.outer_radius_mm
    if within_mm <= 0:
        raise ValueError(
            f"{said} lies outside the block, which reaches from {low_mm:g} to {high_mm:g}"
        )
    if within_mm < least_mm:
        raise ValueError(
            f"{said} is {within_mm:.2g} mm long within the block, which reaches from {low_mm:g} to "
            f"{high_mm:g}; it must be at least {least_mm:.2g} mm to be meshed, a fiftieth of the "
            "outer radius: make it longer, or leave it out"
        )


def _need_course_along(one: Artery, key: str) -> None:
    """A solid is meshed as sections along z, which a vessel must cross."""
    for first, last in pairwise(one.path):
        way_mm = np.subtract(last, first)
        angle_deg = float(np.degrees(np.arctan2(np.hypot(*way_mm[1:]), way_mm[0])))
        if angle_deg > MOST_OBLIQUE_DEG + 1e-6:  # what rounding makes of as much
            raise ValueError(
                f"{key}.path: from z_mm = {first[0]:g} to {last[0]:g} it runs at {angle_deg:.0f} "
                f"degrees to z, at most {MOST_OBLIQUE_DEG:g} in a solid. Turn the block: let z be "
                "the way that the vessel runs"
            )


def mirrored(scene: Scene) -> Scene:
    """The scene seen from the other side; a block only."""
    assert scene.tissue is not None
    width = scene.tissue.width_mm
    inclusion: list[Inclusion] = []
    for one in scene.inclusion:
        change: dict[str, object] = {"x_mm": round(width - one.x_mm, 9)}
        if isinstance(one, Artery) and one.path:
            change["path"] = tuple((z, round(width - x, 9), depth) for z, x, depth in one.path)
        inclusion.append(one.model_copy(update=change))
    finger = scene.indenter.mirrored()
    return scene.model_copy(update={"inclusion": tuple(inclusion), "indenter": finger})


def scene_names() -> list[str]:
    """The scenes that are built in.

    Examples
    --------
    >>> import palpate
    >>> palpate.scene_names()
    ['HAOT', 'SAOT', 'TI', 'TI-solid', 'TIHA', 'TIHA-solid', 'TISA', 'TISA-solid', 'TIT', ...]
    """
    folder = resources.files("sim_backend.scene") / "builtin"
    return sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml"))


def as_scene(scene: Scene | str | Path) -> Scene:
    """The scene itself, a built-in one by name, or one from a file. Raises `SceneError`."""
    return scene if isinstance(scene, Scene) else load_scene(scene)


def load_scene(name_or_path: str | Path) -> Scene:
    """A scene by name, or from a file.

    Parameters
    ----------
    name_or_path
        A built-in scene (`scene_names`), or a TOML file. A wave file is looked for beside
        it; the scene holds its full path.

    Returns
    -------
    Scene
        Checked: its geometry is possible.

    Raises
    ------
    SceneError
        Names the key, its value and what is allowed.

    Examples
    --------
    >>> import palpate
    >>> palpate.load_scene("TIHA").tissue.modulus_kpa
    50.0
    """
    path = path_of(name_or_path, "a Scene, the name of a built-in one or of a scene file")
    if str(name_or_path) in scene_names():
        built_in = resources.files("sim_backend.scene") / "builtin" / f"{name_or_path}.toml"
        return scene_from_text(built_in.read_bytes(), str(name_or_path))
    if not path.exists():
        raise SceneError(
            f"{name_or_path}: neither a file nor a built-in scene ({', '.join(scene_names())})"
        )
    try:
        content = read_file(path, MAX_FILE_BYTES)
    except FileRefused as error:
        raise SceneError(f"{error}; not a scene file") from None
    scene = scene_from_text(content, str(path))
    if scene.pulse.wave in WAVES:
        return scene
    wave = str((path.parent / scene.pulse.wave).resolve())
    return scene.model_copy(update={"pulse": scene.pulse.model_copy(update={"wave": wave})})


def scene_from_text(text: str | bytes, source: str) -> Scene:
    """Read a scene from TOML text; ``source`` is named in errors. Raises `SceneError`."""
    try:
        return Scene.model_validate(parse_toml(text.encode() if isinstance(text, str) else text))
    except ValidationError as error:
        raise SceneError("\n".join(f"{source}: {line}" for line in explain(error, Scene))) from None
    except ValueError as error:
        raise SceneError(f"{source}: {error}") from None
