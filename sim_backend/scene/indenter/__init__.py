"""The fingers that a scene file may name: one file a shape, each with a class of `Indenter`.

A plane scene's section cuts across a finger; a solid has it whole.
"""

from functools import reduce
from importlib import import_module
from operator import or_
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, Discriminator, Tag

from sim_backend.scene.indenter.base import Indenter, RoundIndenter
from sim_backend.scene.indenter.cylinder import Cylinder
from sim_backend.scene.indenter.flat import Flat
from sim_backend.scene.indenter.punch import Punch
from sim_backend.scene.indenter.skin import Skin
from sim_backend.scene.indenter.sphere import Sphere
from sim_backend.scene.indenter.wedge import Cone, Wedge

__all__ = ["SHAPES", "AnyIndenter", "Cone", "Cylinder", "Flat", "Indenter", "Punch", "Skin",
           "Sphere", "Wedge"]  # fmt: skip


for module in iter_modules(__path__):
    import_module(f"{__name__}.{module.name}")
SHAPES = (*Indenter.__subclasses__(), *RoundIndenter.__subclasses__())
SHAPES = tuple(one for one in SHAPES if hasattr(one, "tag"))


def _kind(finger: Any) -> str | None:
    """Which finger a table means: a ``flat`` with a diameter is round."""
    if isinstance(finger, Indenter):
        return finger.tag
    keys = vars(finger) if isinstance(finger, BaseModel) else finger
    if not isinstance(keys, dict):
        return None
    shape = keys.get("shape", "cylinder")
    return "round flat" if shape == "flat" and "diameter_mm" in keys else shape


def _named(plane: str) -> str:
    return ", ".join(sorted({one.tag.split()[-1] for one in SHAPES if plane in one.planes}))


if TYPE_CHECKING:
    AnyIndenter = Indenter
else:
    AnyIndenter = Annotated[
        reduce(or_, (Annotated[one, Tag(one.tag)] for one in SHAPES)),
        Discriminator(
            _kind,
            custom_error_type="finger",
            custom_error_message=f"shape must be one of {_named('stress')}; in a solid one of "
            f"{_named('solid')}",
        ),
    ]
