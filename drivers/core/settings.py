"""A driver's settings: one validated model, from which the rig file is checked and documented."""

from typing import Annotated

from pydantic import Field

from drivers.core.table import Table

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Baud = Annotated[int, Field(gt=0)]
Point = tuple[float, float, float]


class Settings(Table):
    """The keys of a device's table in a rig file. ``simulated``: an emulator answers."""

    name: Annotated[str, Field(min_length=1)]
    simulated: bool = False
