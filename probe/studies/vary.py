"""What a sweep varies, and the points that it makes: ``KEY=VALUES`` over a scene or its scan.

Values are a list ``10,12,14``, a range ``10..14:5`` (five, evenly; ``:5log`` in the logarithm), or
an interval ``10..14`` (``10..14:log``) that a random design draws from.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import product
from numbers import Integral
from typing import Any, Literal, get_args

import numpy as np
from scipy.stats import qmc

from drivers import ConfigError
from sim_backend.scene.scene_file import Scene

Design = Literal["full", "zip", "lhs", "sobol"]
Value = float | str | bool
Point = dict[str, Value]

SCAN_KEYS = ("x_mm", "indentation_mm")
MAX_POINTS = 1_000_000
"""Of a sweep: at the 0.1 s of the quickest presses more than a day."""
SYNTAX = "say KEY=10,12,14 or KEY=10..14:5 or, for a random design, KEY=10..14"


@dataclass(frozen=True)
class Varied:
    """A ``key`` with its ``values``, or an interval ``low`` to ``high`` (``log``: evenly in its
    logarithm)."""

    key: str
    values: tuple[Value, ...] = ()
    low: float = 0.0
    high: float = 0.0
    log: bool = False

    def at(self, share: float) -> Value:
        """The value at ``share`` of the way, 0 to 1."""
        if self.values:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))


def keys_and_values(texts: Sequence[str]) -> dict[str, str]:
    """``KEY=VALUES`` of each ``--vary``. Raises `ConfigError` for one without =, or given twice."""
    found: dict[str, str] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        if not equals or not values:
            raise ConfigError(f"--vary {text}: {SYNTAX}")
        if found.setdefault(key.strip(), values) is not values:
            raise ConfigError(f"--vary: a key is given twice ({key.strip()})")
    return found


def parse(text: str, scene: Scene) -> Varied:
    """One ``--vary``. Raises `ConfigError` naming the key or value."""
    key, equals, values = text.partition("=")
    if not equals or not values:
        raise ConfigError(f"--vary {text}: {SYNTAX}")
    key = full_key(key.strip(), scene)
    if ".." not in values:
        given = tuple(_value(v) for v in values.split(","))
        now = _leaves(scene.model_dump(mode="json")).get(key, 0.0)
        is_number = isinstance(now, int | float) and not isinstance(now, bool)
        if is_number and (texts := [v for v in given if isinstance(v, str | bool)]):
            raise ConfigError(f"--vary {text}: {texts[0]!r} is no number")
        return Varied(key, given)
    interval, _, rest = values.partition(":")
    try:
        low, high = (float(end) for end in interval.split(".."))
        log = rest.endswith("log")
        number = rest.removesuffix("log")
        count = int(number) if number else 0
    except ValueError:
        raise ConfigError(f"--vary {text}: {SYNTAX}") from None
    if log and min(low, high) <= 0:
        raise ConfigError(f"--vary {text}: a logarithmic range must be above 0")
    if not count:
        return Varied(key, low=low, high=high, log=log)
    if not 1 <= count <= MAX_POINTS:
        raise ConfigError(f"--vary {text}: from 1 to {MAX_POINTS} values are possible")
    space = np.geomspace if log else np.linspace
    return Varied(key, tuple(float(v) for v in space(low, high, count)))


def places(text: str) -> tuple[float, ...]:
    """``32``, ``20,32`` or ``4..60:15`` as places [mm]; none for no text. Raises `ConfigError`."""
    if not text:
        return ()
    try:
        if ".." not in text:
            return tuple(float(one) for one in text.split(","))
        interval, _, many = text.partition(":")
        low, high = (float(end) for end in interval.split(".."))
        if not 1 <= (count := int(many)) <= MAX_POINTS:
            raise ValueError(count)
        return tuple(float(one) for one in np.linspace(low, high, count))
    except ValueError:
        raise ConfigError(f"--x {text}: say 32 or 20,32 or 4..60:15 (from..to:how many)") from None


def full_key(key: str, scene: Scene) -> str:
    """``wall_mm`` as ``inclusion.0.wall_mm``. Raises `ConfigError` if none or several match."""
    if key in SCAN_KEYS:
        return key
    known = list(_leaves(scene.model_dump(mode="json")))
    matches = [k for k in known if k == key] or [k for k in known if k.endswith("." + key)]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise ConfigError(f"--vary {key}: which of {', '.join(matches)}?")
    short = {name.rpartition(".")[2] for name in (*SCAN_KEYS, *known)}
    near = get_close_matches(key.rpartition(".")[2], short, 1)
    guess = f" (did you mean {near[0]}?)" if near else ""
    raise ConfigError(
        f"--vary {key}: no such key{guess}; known are {', '.join((*SCAN_KEYS, *known))}"
    )


def points(varied: Sequence[Varied], design: Design, count: int, seed: int) -> list[Point]:
    """All points, in a fixed order. Raises `ConfigError` for what a design cannot do."""
    keys = [v.key for v in varied]
    if design not in get_args(Design):
        raise ConfigError(f"--design {design}: must be {', '.join(get_args(Design))}")
    if len(set(keys)) < len(keys):
        raise ConfigError(f"--vary: a key is given twice ({', '.join(keys)})")
    if design in ("full", "zip"):
        for one in varied:
            if not one.values:
                raise ConfigError(
                    f"--vary {one.key}={one.low:g}..{one.high:g}: how many? {one.low:g}.."
                    f"{one.high:g}:5, or --design lhs"
                )
        lists = [v.values for v in varied]
        if design == "zip" and len({len(v) for v in lists}) > 1:
            raise ConfigError("--design zip: every key needs as many values as the others")
        if design == "full" and (many := math.prod(len(v) for v in lists)) > MAX_POINTS:
            raise ConfigError(
                f"--vary: makes {many:.3g} points, at most {MAX_POINTS} are possible; take fewer "
                "values, or --design lhs"
            )
        rows = zip(*lists, strict=True) if design == "zip" else product(*lists)
        return [dict(zip(keys, row, strict=True)) for row in rows]
    if not (isinstance(count, Integral) and 1 <= count <= MAX_POINTS):
        raise ConfigError(
            f"--count {count}: how many points of --design {design}? 1 to {MAX_POINTS}"
        )
    if seed < 0:
        raise ConfigError(f"--seed {seed}: must be 0 or more")
    make = qmc.LatinHypercube if design == "lhs" else qmc.Sobol
    sampler: Any = make(d=len(varied), rng=seed)
    if design == "sobol":  # drawn by powers of two, as the sequence is balanced
        shares = sampler.random_base2(int(np.ceil(np.log2(count))))[:count]
    else:
        shares = sampler.random(count)
    return [{v.key: v.at(float(s)) for v, s in zip(varied, row, strict=True)} for row in shares]


def applied(scene: Scene, point: Point) -> Scene:
    """The scene with a point's values. Raises `SceneError` or a validation error."""
    raw = scene.model_dump(mode="json")
    for key, value in point.items():
        if key in SCAN_KEYS:
            continue
        *path, last = key.split(".")
        table: Any = raw
        for part in path:
            table = table[int(part)] if part.isdigit() else table[part]
        table[last] = value
    return Scene.model_validate(raw)


def _leaves(raw: Any, prefix: str = "") -> dict[str, Any]:
    """Values by their keys, as ``inclusion.0.wall_mm``, without lists and names."""
    found: dict[str, Any] = {}
    items = raw.items() if isinstance(raw, dict) else enumerate(raw)
    for key, value in items:
        if isinstance(value, dict) or (isinstance(value, list) and value
                                       and isinstance(value[0], dict)):  # fmt: skip
            found |= _leaves(value, f"{prefix}{key}.")
        elif not isinstance(value, list) and key != "name":
            found[f"{prefix}{key}"] = value
    return found


def _value(text: str) -> Value:
    switches = {"true": True, "false": False}
    try:
        return float(text)
    except ValueError:
        return switches.get(text.strip().lower(), text.strip())
