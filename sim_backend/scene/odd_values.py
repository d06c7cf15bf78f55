"""Sizes, moduli and pressures of a scene that may be in another unit than their key's."""

from collections.abc import Iterator

from pydantic import BaseModel

from sim_backend.scene.scene_file import Scene

SLIP = 100.0
"""How many times as large or small as usual a value in doubt is: a slip of the unit makes it a
thousand times, cm2 for mm2 a hundred. Of the built-in scenes the furthest is 40 times the usual, in
``rigs/`` 12 times."""
USUAL = {"_mm": 10.0, "_kpa": 100.0, "_mmhg": 100.0}
"""A finger, soft tissue, blood: fat has 1 to 3 kPa, a stenosis in the paper 4000."""
NOT_SIZES = ("x_mm", "z_mm", "depth_mm", "edge_radius_mm")
"""A place may be near zero, an edge as sharp as one likes."""


def odd_values(scene: Scene) -> Iterator[str]:
    """Why each value of a scene that is in doubt is.

    Examples
    --------
    >>> import palpate
    >>> from sim_backend.scene.odd_values import odd_values
    >>> list(odd_values(palpate.load_scene("TIHA")))
    []
    """
    yield from _of(scene, "")


def _of(table: BaseModel, where: str) -> Iterator[str]:
    for key, value in table:
        name = f"{where}{key}"
        if isinstance(value, BaseModel):
            yield from _of(value, f"{name}.")
        elif isinstance(value, tuple):
            for n, one in enumerate(value):
                if isinstance(one, BaseModel):
                    yield from _of(one, f"{name}[{n}].")
        elif key not in NOT_SIZES and isinstance(value, float) and value > 0:
            usual = next((u for unit, u in USUAL.items() if key.endswith(unit)), value)
            if words := doubt(name, value, usual):
                yield words


def doubt(key: str, value: float, usual: float) -> str:
    """Why a value above 0 may be in another unit; empty if it is near the usual one."""
    if 1 / SLIP < value / usual < SLIP:
        return ""
    times = f"{max(value / usual, usual / value):,.0f} times {'more' if value > usual else 'less'}"
    return f"{key} = {value:g}: {times} than the usual {usual:g}; is its unit right?"
