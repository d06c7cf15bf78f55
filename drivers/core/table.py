"""What every table of a file that people write shares: a rig's, a device's, a scene's."""

from collections.abc import Iterator
from typing import Any, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError


class Table(BaseModel):
    """No unknown key, no infinite number, nothing taken for another kind; frozen.

    pydantic takes true for 1 and "4" for 4: a probe 1 mm wide where somebody meant a switch.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )

    @model_validator(mode="wrap")
    @classmethod
    def _of_their_kinds(cls, written: Any, read_as: ModelWrapValidatorHandler[Self]) -> Self:
        read = read_as(written)
        if isinstance(written, dict):
            own = {key: getattr(read, key) for key in cls.model_fields if key in written}
            if faults := list(_mistaken(written, own, ())):
                raise ValidationError.from_exception_data(cls.__name__, faults)
        return read


def _mistaken(written: Any, read: Any, where: tuple[int | str, ...]) -> Iterator[InitErrorDetails]:
    """Each number or switch that was written as something else."""
    if isinstance(written, list) and isinstance(read, list | tuple) and len(written) == len(read):
        for n, pair in enumerate(zip(written, read, strict=True)):
            yield from _mistaken(*pair, (*where, n))
    elif isinstance(written, dict) and isinstance(read, dict):
        for key in written.keys() & read.keys():
            yield from _mistaken(written[key], read[key], (*where, key))
    elif isinstance(read, bool) and not isinstance(written, bool):
        yield _fault("should be true or false", written, where)
    elif type(read) in (int, float) and isinstance(written, bool):
        yield _fault("should be a number", written, where)
    elif type(read) in (int, float) and isinstance(written, str):
        yield _fault("should be a number, without quotes", written, where)


def _fault(text: str, written: Any, where: tuple[int | str, ...]) -> InitErrorDetails:
    return InitErrorDetails(
        type=PydanticCustomError("kind", "Input {text}", {"text": text}), loc=where, input=written
    )
