"""A driver's settings: one validated model, from which the rig file is checked and documented."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Point = tuple[float, float, float]


class Settings(BaseModel):
    """The keys of a device's table in a rig file. ``simulated``: an emulator answers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    name: Annotated[str, Field(min_length=1)]
    simulated: bool = False
