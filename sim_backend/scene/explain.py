"""Why a value is refused, in words: the key, its value, and what is allowed there."""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

SAID = {
    "missing": "is missing",
    "float_parsing": "must be a number",
    "float_type": "must be a number",
    "int_parsing": "must be a whole number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
}
"""What pydantic's types of faults are called here; of others its own message is taken."""


def explain(error: ValidationError, model: type[BaseModel] | None = None) -> list[str]:
    """One line per fault: key, value, what is allowed; of ``model``, what keys there are."""
    lines = []
    for fault in error.errors():
        key = ".".join(str(part) for part in fault["loc"])
        value = fault["input"]
        shown = "" if isinstance(value, dict) or fault["type"] == "missing" else f" = {value!r}"
        text = allowed(fault)
        if model is not None and fault["type"] == "extra_forbidden":
            text = _unknown_key(model, fault["loc"])
        between = " " if fault["type"] == "missing" else ": "
        lines.append(f"{key}{shown}{between}{text}".lstrip(": "))
    return lines


def allowed(fault: Mapping[str, Any]) -> str:
    """What one of pydantic's faults asks for, as in "must be greater than 0"."""
    said = str(fault["msg"]).removeprefix("Value error, ")
    return SAID.get(fault["type"], said.replace("Input should be", "must be", 1))


def _unknown_key(model: type[BaseModel], where: tuple[int | str, ...]) -> str:
    """What the table at ``where`` knows, the likeliest first."""
    tables = [model]
    for part in where[:-1]:
        fields = [t.model_fields[part] for t in tables if part in t.model_fields]
        tables = [one for f in fields for one in _tables(f.annotation)] or tables
        tables = [t for t in tables if str(part) == _kind(t)] or tables  # the tag of a union
    known = sorted({key for table in tables for key in table.model_fields})
    near = get_close_matches(str(where[-1]), known, 1)
    guess = f" (did you mean {near[0]}?)" if near else ""
    return f"unknown key{guess}; known here: {', '.join(known)}"


def _tables(annotation: Any) -> list[type[BaseModel]]:
    """Every table within an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for part in get_args(annotation) for table in _tables(part)]


def _kind(table: type[BaseModel]) -> str:
    """The word that tells a table from others in its place, such as artery or cylinder."""
    for key in ("kind", "shape"):
        if key in table.model_fields:
            return str(next(iter(get_args(table.model_fields[key].annotation)), ""))
    return ""
