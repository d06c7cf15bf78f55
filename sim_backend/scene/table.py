"""What every table of the scene file shares: no unknown keys, no infinite numbers, frozen."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Table(BaseModel):
    """One table of a scene file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def is_unset(value: object) -> bool:
    """Whether an optional key was left out; such keys are left out of what is written, too."""
    return value is None
