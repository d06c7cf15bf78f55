"""The scene file: what lies in the phantom, how it is pressed and how it beats.

Keys carry their units (``depth_mm``, ``modulus_kpa``); ``depth_mm`` is from the surface to a
centre. Impossible geometry is refused with the key, the value and what is allowed.
"""

import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

MAX_FILE_BYTES = 1_000_000
WAVES = ("paper", "brachial")
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Poisson = Annotated[float, Field(ge=0, lt=0.5)]


class SceneError(ValueError):
    """A scene that cannot be: the text names file, key, value and what is allowed."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Tissue(_Table):
    """The block; ``relaxation`` is a Prony series of [weight, tau_s] pairs of the stiffness."""

    width_mm: Positive
    height_mm: Positive
    modulus_kpa: Positive
    poisson: Poisson
    relaxation: tuple[tuple[float, Positive], ...] = ()

    @field_validator("relaxation")
    @classmethod
    def _weights(cls, pairs: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if any(g <= 0 for g, _ in pairs) or sum(g for g, _ in pairs) >= 1:
            raise ValueError("weights must be positive and sum to less than 1")
        return pairs


class Stenosis(_Table):
    """A concentric ring that takes ``fraction`` of the lumen's diameter."""

    fraction: Annotated[float, Field(gt=0, lt=1)]
    modulus_kpa: Positive
    z_mm: tuple[float, float] | None = None


class _Round(_Table):
    x_mm: float
    depth_mm: Positive
    modulus_kpa: Positive
    poisson: Poisson

    @property
    def outer_radius_mm(self) -> float:
        raise NotImplementedError


class Tumour(_Round):
    """A round lump, glued to the tissue; in a grid scan a sphere centred at ``z_mm``."""

    kind: Literal["tumour"]
    diameter_mm: Positive
    z_mm: float | None = None

    @property
    def outer_radius_mm(self) -> float:
        return self.diameter_mm / 2


class Artery(_Round):
    """A tube with a lumen under pressure; ``path`` of [z_mm, x_mm, depth_mm] for grids."""

    kind: Literal["artery"]
    inner_diameter_mm: Positive
    wall_mm: Positive
    stenosis: Stenosis | None = None
    path: tuple[tuple[float, float, float], ...] = ()

    @property
    def outer_radius_mm(self) -> float:
        return self.inner_diameter_mm / 2 + self.wall_mm

    @model_validator(mode="after")
    def _wall(self) -> Self:
        if self.wall_mm > self.outer_radius_mm - 0.01:
            raise ValueError(
                f"wall_mm = {self.wall_mm:g} leaves no lumen: it must stay below the outer radius"
            )
        if self.path and any(b[0] <= a[0] for a, b in zip(self.path, self.path[1:], strict=False)):
            raise ValueError("path: z_mm must increase from point to point")
        return self


class Skin(_Table):
    """A thin soft layer on the finger, inside its outline. It gives way where it is pressed and
    only there (elastic foundation), which an incompressible layer does not."""

    thickness_mm: Positive
    modulus_kpa: Positive
    poisson: Annotated[float, Field(ge=0, le=0.45)] = 0.3

    @property
    def m_per_pa(self) -> float:
        """How much the layer gives way under a pressure, not bulging sideways (Johnson 1985,
        Contact Mechanics, eq. 4.57)."""
        nu = self.poisson
        confined = (1 - nu) / ((1 + nu) * (1 - 2 * nu)) * 1e3 * self.modulus_kpa
        return 1e-3 * self.thickness_mm / confined


class Cylinder(_Table):
    """A round finger, rigid under its skin if it has one. ``bonded``: what it touches sticks."""

    shape: Literal["cylinder"] = "cylinder"
    radius_mm: Positive = 5.0
    length_mm: Positive = 10.0
    bonded: bool = False
    skin: Skin | None = None

    @property
    def width_mm_projected(self) -> float:
        return 2 * self.radius_mm

    @model_validator(mode="after")
    def _thin(self) -> Self:
        _thin_skin(self.skin, "radius_mm", self.radius_mm)
        return self


class Flat(_Table):
    """A flat finger with rounded edges; otherwise as `Cylinder`."""

    shape: Literal["flat"]
    width_mm: Positive
    edge_radius_mm: Positive
    length_mm: Positive = 10.0
    bonded: bool = False
    skin: Skin | None = None

    @property
    def width_mm_projected(self) -> float:
        return self.width_mm

    @model_validator(mode="after")
    def _edges(self) -> Self:
        if self.edge_radius_mm > self.width_mm / 2:
            raise ValueError(
                f"edge_radius_mm = {self.edge_radius_mm:g} must not exceed half of width_mm"
            )
        _thin_skin(self.skin, "half of width_mm", self.width_mm / 2)
        return self


def _thin_skin(skin: Skin | None, name: str, half_mm: float) -> None:
    if skin is not None and skin.thickness_mm > half_mm / 4:
        raise ValueError(
            f"skin.thickness_mm = {skin.thickness_mm:g}: at most a quarter of {name}, "
            f"{half_mm / 4:g}"
        )


class Pulse(_Table):
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


Inclusion = Annotated[Tumour | Artery, Field(discriminator="kind")]
Indenter = Annotated[Cylinder | Flat, Field(discriminator="shape")]


class Scene(_Table):
    """A whole scene. Without ``tissue`` the one artery stands alone on a rigid flat support."""

    name: str
    plane: Literal["stress", "strain"] = "stress"
    tissue: Tissue | None = None
    inclusion: tuple[Inclusion, ...] = ()
    indenter: Indenter = Cylinder()
    pulse: Pulse = Pulse()

    @property
    def surface_mm(self) -> float:
        """Height of the untouched surface above the support."""
        if self.tissue is not None:
            return self.tissue.height_mm
        return 2 * self.inclusion[0].outer_radius_mm

    @property
    def arteries(self) -> tuple[Artery, ...]:
        return tuple(i for i in self.inclusion if isinstance(i, Artery))

    @property
    def face_mm2(self) -> float:
        """The indenter's projected area, the default face of the tactile signal."""
        return self.indenter.width_mm_projected * self.indenter.length_mm

    @model_validator(mode="after")
    def _geometry(self) -> Self:
        if self.tissue is None:
            if len(self.inclusion) != 1 or not isinstance(self.inclusion[0], Artery):
                raise ValueError("without a [tissue] table there must be exactly one artery")
            return self
        width, height = self.tissue.width_mm, self.tissue.height_mm
        for n, one in enumerate(self.inclusion):
            r = one.outer_radius_mm
            where = f"inclusion[{n}] ({one.kind})"
            if one.depth_mm - r <= 0:
                raise ValueError(
                    f"{where}: depth_mm = {one.depth_mm:g} breaks the surface; "
                    f"it must be above the outer radius {r:g}"
                )
            if one.depth_mm + r >= height:
                raise ValueError(
                    f"{where}: depth_mm = {one.depth_mm:g} breaks the bottom; "
                    f"it must be below {height - r:g}"
                )
            if not r < one.x_mm < width - r:
                raise ValueError(
                    f"{where}: x_mm = {one.x_mm:g} breaks a side; "
                    f"it must lie between {r:g} and {width - r:g}"
                )
            for m, other in enumerate(self.inclusion[:n]):
                apart = ((one.x_mm - other.x_mm) ** 2 + (one.depth_mm - other.depth_mm) ** 2) ** 0.5
                if apart <= r + other.outer_radius_mm:
                    raise ValueError(
                        f"{where} overlaps inclusion[{m}]: centres are {apart:.3g} mm apart; "
                        f"they must be more than {r + other.outer_radius_mm:g} mm apart"
                    )
        return self


def mirrored(scene: Scene) -> Scene:
    """The scene seen from the other side; a block only."""
    assert scene.tissue is not None
    width = scene.tissue.width_mm
    inclusion = tuple(
        one.model_copy(update={"x_mm": round(width - one.x_mm, 9)}) for one in scene.inclusion
    )
    return scene.model_copy(update={"inclusion": inclusion})


def scene_names() -> list[str]:
    """The scenes that are built in."""
    folder = resources.files("sim_backend") / "scenes"
    return sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml"))


def load_scene(name_or_path: str | Path) -> Scene:
    """A built-in scene by name, or a scene file. Raises `SceneError`.

    A wave file is looked for beside the scene file; the scene holds its full path.
    """
    path = Path(name_or_path)
    if str(name_or_path) in scene_names():
        text = (resources.files("sim_backend") / "scenes" / f"{name_or_path}.toml").read_text()
        return scene_from_text(text, str(name_or_path))
    if not path.is_file():
        raise SceneError(
            f"{name_or_path}: neither a file nor a built-in scene ({', '.join(scene_names())})"
        )
    if path.stat().st_size > MAX_FILE_BYTES:
        raise SceneError(f"{path}: larger than {MAX_FILE_BYTES} bytes; not a scene file")
    try:
        scene = scene_from_text(path.read_text(encoding="utf-8"), str(path))
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not UTF-8 text ({error.reason})") from None
    if scene.pulse.wave in WAVES:
        return scene
    wave = str((path.parent / scene.pulse.wave).resolve())
    return scene.model_copy(update={"pulse": scene.pulse.model_copy(update={"wave": wave})})


def scene_from_text(text: str, source: str) -> Scene:
    """Read a scene from TOML text; ``source`` is named in errors. Raises `SceneError`."""
    try:
        return Scene.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{source}: not TOML: {error}") from None
    except ValidationError as error:
        raise SceneError("\n".join(f"{source}: {line}" for line in explain(error))) from None


def explain(error: ValidationError) -> list[str]:
    """One line per fault: key, value, what is allowed."""
    lines = []
    for fault in error.errors():
        key = ".".join(str(part) for part in fault["loc"])
        value = fault["input"]
        shown = "" if isinstance(value, dict) or fault["type"] == "missing" else f" = {value!r}"
        lines.append(f"{key}{shown}: {fault['msg'].removeprefix('Value error, ')}".lstrip(": "))
    return lines
