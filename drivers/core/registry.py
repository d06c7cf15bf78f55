"""Find a driver by the name a rig file gives it, and open it with the keys of its table.

A third-party package registers a factory under the entry-point group ``palpate.stages`` or
``palpate.sensors``; nothing else is needed. A factory takes the clock and its settings: one model
derived from `Settings`, or keyword arguments. It returns a `Stage` or a `Sensor`, not yet
connected. Planners (``palpate.planners``) are found in the same way; theirs takes the plan.
"""

import inspect
import warnings
from collections.abc import Callable, Collection, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, get_type_hints

from pydantic import BaseModel, create_model

from drivers.core.errors import ConfigError, MissingExtra
from drivers.core.table import Table

Kind = Literal["stages", "sensors", "planners"]


def available(kind: Kind) -> list[str]:
    """Names that a rig file may give as ``driver``."""
    return sorted({point.name for point in entry_points(group=f"palpate.{kind}")})


def find_driver(kind: Kind, name: str) -> Callable[..., Any]:
    """The factory registered as ``name``.

    Raises `ConfigError` naming the known drivers, or saying what is wrong with a broken one.
    """
    for point in entry_points(group=f"palpate.{kind}"):
        if point.name == name:
            return _loaded(point)
    what = _what(kind)
    raise ConfigError(f"{what} = {name!r}: no such {what}; known: {', '.join(available(kind))}")


def _what(kind: str) -> str:
    return "planner" if kind == "planners" else "driver"


def _loaded(point: EntryPoint) -> Callable[..., Any]:
    """Its factory. Raises `ConfigError` where the package that registered it is broken."""
    try:
        factory: Callable[..., Any] = point.load()
        inspect.signature(factory)
        _hints(factory)
    except MissingExtra:  # it says what to install
        raise
    except (Exception, SystemExit) as error:  # the code is of others: it may raise anything
        what = _what(point.group.removeprefix("palpate."))
        raise ConfigError(
            f"{what} = {point.name!r}: the plug-in {point.value!r} is broken "
            f"({type(error).__name__}: {error}); mend the package that registers it, or "
            "uninstall it"
        ) from error
    return factory


def settings_of(kind: Kind, name: str, without: Collection[str] = ()) -> type[BaseModel]:
    """The model of a driver's keys, ``without`` some keywords that no file gives.

    Raises `ConfigError` if there is no such driver.
    """
    factory = find_driver(kind, name)
    return _model(factory) or _model_of_keywords(factory, without)


def open_driver(kind: Kind, name: str, given: Any, keys: Mapping[str, Any]) -> Any:
    """A stage or sensor, not yet connected, with the ``keys`` of its table in the rig file.

    ``given`` is what its factory takes first: the clock, or a planner's plan.

    Raises `ConfigError`, and `pydantic.ValidationError` naming the keys that are wrong.
    """
    factory = find_driver(kind, name)
    model = _model(factory)
    if model is not None:
        return factory(given, model.model_validate(dict(keys)))
    checked = _model_of_keywords(factory).model_validate(dict(keys))
    return factory(given, **{key: getattr(checked, key) for key in checked.model_fields_set})


def _model(factory: Callable[..., Any]) -> type[BaseModel] | None:
    """The settings model that a factory takes as its second argument, if it does."""
    parameters = list(inspect.signature(factory).parameters)
    if len(parameters) != 2:
        return None
    found = _hints(factory).get(parameters[1])
    return found if isinstance(found, type) and issubclass(found, BaseModel) else None


def _hints(factory: Callable[..., Any]) -> dict[str, Any]:
    """The types of a factory's parameters; a class is one, too."""
    made_by = factory.__init__ if isinstance(factory, type) else factory  # type: ignore[misc]
    return get_type_hints(made_by, include_extras=True)


def _model_of_keywords(
    factory: Callable[..., Any], without: Collection[str] = ()
) -> type[BaseModel]:
    """A model made of the keyword arguments of a factory, described by what it says of itself."""
    hints = _hints(factory)
    empty = inspect.Parameter.empty
    fields: dict[str, Any] = {
        parameter.name: (
            hints.get(parameter.name, Any),
            ... if parameter.default is empty else parameter.default,
        )
        for parameter in list(inspect.signature(factory).parameters.values())[1:]
        if parameter.name not in without
    }
    with warnings.catch_warnings():  # a key may be called as a method of the model is
        warnings.simplefilter("ignore", UserWarning)
        return create_model(
            f"{factory.__module__}.{factory.__name__}", __base__=Table,
            __doc__=inspect.getdoc(factory) or "", **fields,
        )  # fmt: skip
