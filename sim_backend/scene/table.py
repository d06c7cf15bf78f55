"""What every table of the scene file shares."""

from typing import Annotated

from pydantic import Field

from drivers.core.table import Table

__all__ = ["Positive", "Table", "is_unset"]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


def is_unset(value: object) -> bool:
    """Whether an optional key was left out; such keys are left out of what is written, too."""
    return value is None
