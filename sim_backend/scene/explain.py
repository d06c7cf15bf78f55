"""Why a value is refused, in words: the key, its value, and what is allowed there."""

import re
from collections.abc import Iterable, Mapping, Sized
from difflib import get_close_matches
from typing import Any, ClassVar, get_args

from pydantic import BaseModel, ValidationError

A_NUMBER, A_WHOLE_NUMBER, A_TABLE = "must be a number", "must be a whole number", "must be a table"
A_SWITCH = "must be true or false"
SAID = {
    "missing": "is missing",
    "float_parsing": A_NUMBER,
    "float_type": A_NUMBER,
    "int_parsing": A_WHOLE_NUMBER,
    "int_type": A_WHOLE_NUMBER,
    "int_from_float": A_WHOLE_NUMBER,
    "int_parsing_size": A_WHOLE_NUMBER,
    "bool_type": A_SWITCH,
    "bool_parsing": A_SWITCH,
    "string_type": "must be text, in quotes",
    "tuple_type": "must be a list, in [ ]",
    "too_short": "must have {min_length} or more entries",
    "too_long": "must have at most {max_length} entries",
    "model_type": A_TABLE,
    "model_attributes_type": A_TABLE,
    "dict_type": A_TABLE,
    "union_tag_not_found": "{discriminator} is missing",
    "union_tag_invalid": "{discriminator} = {tag!r}: must be one of {expected_tags}",
}
"""What pydantic's types of faults are called here; of others its own message is taken."""
BRANCH = re.compile(r"float|int|constrained-\w+|(tuple|list|function-\w+)\[.*\]")
"""How pydantic names what a value may be: the file that a person wrote has no such key."""


def explain(error: ValidationError, model: type[BaseModel] | None = None) -> list[str]:
    """One line per fault: key, value, what is allowed; of ``model``, what keys there are."""
    lines = []
    for fault in _for_what_was_meant(error.errors()):
        key = ".".join(str(part) for part in _without_branches(fault))
        value = fault["input"]
        shown = "" if isinstance(value, dict) or fault["type"] == "missing" else f" = {value!r}"
        text = allowed(fault)
        if fault["type"] == "tuple_type" and isinstance(value, dict) and "." not in key:
            text = f"is a list of tables: write [[{key}]], in two brackets"
        number = fault["loc"][-1] if fault["loc"] else None
        if fault["type"] == "missing" and isinstance(number, int):
            # of several that are missing the first says it
            if isinstance(value, Sized) and number > len(value):
                continue
            key = key.rpartition(".")[0]
            text = f"has {number} value{'s' * (number != 1)}, and needs more"
        if model is not None and fault["type"] == "extra_forbidden":
            text = _unknown_key(model, fault["loc"]) + getattr(model, "beyond", "")
        between = " " if fault["type"] == "missing" else ": "
        lines.append(f"{key}{shown}{between}{text}".lstrip(": "))
    return lines


class Explained(BaseModel):
    """What a whole file holds: made in Python, it is refused in the words that its author reads."""

    refusal: ClassVar[type[ValueError]]
    beyond: ClassVar[str] = ""
    """What is said after an unknown key: where it stands what such a file cannot say."""

    def __init__(self, **keys: Any) -> None:
        """Raises ``refusal``."""
        try:
            super().__init__(**keys)
        except ValidationError as error:
            raise self.refusal("\n".join(explain(error, type(self)))) from None

    # not called where a file is read (`model_validate`), whose faults are explained with its name
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]


def allowed(fault: Mapping[str, Any]) -> str:
    """What one of pydantic's faults asks for, as in "must be greater than 0"."""
    if (words := SAID.get(fault["type"])) is not None:
        return words.format(**fault.get("ctx", {}))
    said = str(fault["msg"]).removeprefix("Value error, ")
    return said.replace("Input should be", "must be", 1)


def _without_branches(fault: Mapping[str, Any]) -> tuple[int | str, ...]:
    where: tuple[int | str, ...] = fault["loc"]
    if fault["type"] == "extra_forbidden":
        return where
    return tuple(part for part in where if not BRANCH.fullmatch(str(part)))


def _for_what_was_meant(faults: Iterable[Any]) -> Iterable[Any]:
    """Where a number or a list may stand: of a list what is wrong within it, of anything else that
    it is no number. Of a list whose entries are wrong, not that too few are left."""
    for fault in faults:
        where, is_list = fault["loc"], isinstance(fault["input"], list | tuple)
        if fault["type"] == "too_short" and len(fault["input"]) >= fault["ctx"]["min_length"]:
            continue
        branch = next((part for part in where if BRANCH.fullmatch(str(part))), "")
        meant = is_list == str(branch).startswith(("tuple[", "list["))
        if not branch or meant or where[-1] != branch:
            yield fault


def _unknown_key(model: type[BaseModel], where: tuple[int | str, ...]) -> str:
    """What the table at ``where`` knows, the likeliest first."""
    tables = [model]
    for part in where[:-1]:
        fields = [f for t in tables for key, f in t.model_fields.items() if part in (key, f.alias)]
        tables = [one for f in fields for one in _tables(f.annotation)] or tables
        tables = [t for t in tables if str(part) == _kind(t)] or tables  # the tag of a union
    known = sorted({f.alias or key for table in tables for key, f in table.model_fields.items()})
    near = get_close_matches(str(where[-1]), known, 1)
    guess = f" (did you mean {near[0]}?)" if near else ""
    return f"unknown key{guess}; known here: {', '.join(known)}"


def _tables(annotation: Any) -> list[type[BaseModel]]:
    """Every table within an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for part in get_args(annotation) for table in _tables(part)]


def _kind(table: type[BaseModel]) -> str:
    """The word that distinguishes a table from others in its place, such as artery or cylinder."""
    for key in ("kind", "shape"):
        if key in table.model_fields:
            return str(next(iter(get_args(table.model_fields[key].annotation)), ""))
    return ""
