"""What every table of the scene file shares."""

from collections.abc import Mapping
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, Field

from drivers.core import table

__all__ = ["Positive", "Table", "beyond_a_file", "is_unset"]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Table(table.Table):
    """Of a scene: a changed copy is checked as well."""

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Another with other values, which are checked as those of a file are."""
        if deep or not update:
            return super().model_copy(update=update, deep=deep)
        own = {key: getattr(self, key) for key in self.model_fields_set}
        return type(self).model_validate(own | dict(update))


OneTable = TypeVar("OneTable", bound=Table)


def beyond_a_file(one: OneTable, changes: Mapping[str, Any]) -> OneTable:
    """A copy as no file may say it, unchecked: what is solved may lie beyond the block."""
    return BaseModel.model_copy(one, update=changes)


def is_unset(value: object) -> bool:
    """Whether an optional key was left out; such keys are left out of what is written, too."""
    return value is None
