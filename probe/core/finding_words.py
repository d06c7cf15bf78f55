"""A finding in a person's words: the same in the terminal, in windows and on the page."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

NORMAL_95 = 1.96
MAX_NAMED = 3
PLURAL = {
    "artery": "arteries",
    "stenotic artery": "stenotic arteries",
    "tumour": "tumours",
    "undecided": "undecided",
}
AT_AN_END = (
    "its signal is largest where the stations end: it lies here or beyond, or the tissue itself "
    "changes there; press beyond it too, until the signal falls"
)


def headline(found: Mapping[str, Any]) -> str:
    """The finding in a few words: all objects by name, and what could not be seen."""
    if found["finding"] == "cannot see":
        return (
            f"cannot see: a pulse of {_pascal(found['asked_pa'], 2)} was asked for, "
            f"{_pascal(found['needed_pa'], 2)} would have been needed"
        )
    kinds = [one["kind"] for one in found["objects"]]
    if len(kinds) < 2:
        return str(found["finding"])
    counts = {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}
    return ", ".join(f"{n} {PLURAL[kind] if n > 1 else kind}" for kind, n in counts.items())


def object_line(one: Mapping[str, Any]) -> str:
    """One object with what is known of it; what is not known is not mentioned."""
    parts = [str(one["kind"])]
    if _along_rows(one):
        parts[0] += " along the rows"
    elif one["position_mm"] is not None:
        parts[0] += f" at x = {one['position_mm']:.2f} mm"
    if one.get("position_ci_mm") and not _along_rows(one):
        low, high = one["position_ci_mm"]
        parts[0] += f" (95 %: {low:.2f} to {high:.2f})"
    if (peak_pa := one.get("peak_pa")) is not None:
        parts.append(f"{'softer' if peak_pa < 0 else 'stiffer'} by {_pascal(abs(peak_pa), 3)}")
    if one.get("pulse_pa") is not None:
        parts.append(f"pulse {_pascal(one['pulse_pa'], 3)}")
    parts += sizes_words(one)
    if one["kind"] != "undecided":  # of which kind would it be?
        parts.append(f"confidence {percent(one['confidence'])}")
    return ", ".join(parts + over_rows(one))


SIZES = {"depth": ("_mm", " mm", 1), "diameter": ("_mm", " mm", 1),
         "modulus": ("_kpa", " kPa", 1), "stenosis": ("", " %", 100)}  # fmt: skip
"""How the keys of each end, its unit as it is shown, and how many of that its own are."""


def sizes_words(one: Mapping[str, Any]) -> list[str]:
    """Depth, diameter, stiffness and narrowing with their 95 % intervals, or their bounds."""
    parts = []
    for name, (key, unit, per) in SIZES.items():
        said = [one.get(name + key), *(one.get(f"{name}_ci{key}") or (None, None))]
        value, low, high = (None if number is None else per * number for number in said)
        of = "inner diameter" if name == "diameter" and "artery" in one["kind"] else name
        if value is not None:
            parts.append(f"{of} {value:.3g}{unit} (95 %: {low or 0:.3g} to {high:.3g})")
        elif low is not None:
            parts.append(f"{of} above {plain(low, 2)}{unit}")
        elif high is not None:
            parts.append(f"{of} below {plain(high, 2)}{unit}")
    return parts


def unknown_words(one: Mapping[str, Any]) -> list[str]:
    """What of its depth, size and stiffness is not known, and why: a line for each reason."""
    reasons: dict[str, list[str]] = {}
    for name, why in (one.get("undecided_because") or {}).items():
        reasons.setdefault(why, []).append(name)
    return [f"{', '.join(names)} unknown: {why}" for why, names in reasons.items()]


def summary(found: Mapping[str, Any]) -> list[str]:
    """The finding in lines: the headline, what it is made of, why, and what was assumed."""
    objects = [line for one in found["objects"] for line in (object_line(one), *unknown_words(one))]
    lines = (*objects, *remarks(found))
    return [f"Finding: {headline(found)}", *(f"  {line}" for line in lines)]


def remarks(found: Mapping[str, Any]) -> list[str]:
    """The heart rate, why the finding is what it is, and what was assumed."""
    lines = (
        heart_rate_line(found), hold_down_line(found), found.get("reason"), assumption(found),
    )  # fmt: skip
    return [line for line in lines if line]


def _along_rows(one: Mapping[str, Any]) -> bool:
    """Whether it is a vessel whose course is nearer to x than to y."""
    course = one.get("course_mm") or [(0.0, 0.0)]
    (x_mm, y_mm), (last_x_mm, last_y_mm) = course[0], course[-1]
    return bool(abs(last_x_mm - x_mm) > abs(last_y_mm - y_mm))


def over_rows(one: Mapping[str, Any]) -> list[str]:
    """Where an object of a grid was seen across the rows, and where a vessel is stenosed."""
    parts = []
    if course := one.get("course_mm"):
        (x_mm, y_mm), (last_x_mm, last_y_mm) = course[0], course[-1]
        parts.append(
            f"at y = {_tenths(y_mm)} mm"
            if len(course) == 1
            else f"seen from x, y = {_tenths(x_mm)}, {_tenths(y_mm)} to {_tenths(last_x_mm)}, "
            f"{_tenths(last_y_mm)} mm"
        )
    if stenosed := one.get("stenosed_mm"):
        first, last = (f"{y_mm:.1f}" for y_mm in stenosed)
        rows = f"at y = {first}" if first == last else f"from y = {first} to {last}"
        parts.append(f"stenosed {rows} mm")
    return parts


def _tenths(value: float) -> str:
    """With one decimal, and never -0.0."""
    return f"{round(value, 1) + 0.0:.1f}"


def heart_rate_line(found: Mapping[str, Any]) -> str:
    """The heart rate with its interval; empty where no pulse was found."""
    if not found.get("heart_rate_bpm"):
        return ""
    low, high = found["heart_rate_ci_bpm"]
    return f"heart rate {found['heart_rate_bpm']:.0f} /min (95 %: {low:.0f} to {high:.0f})"


def hold_down_line(found: Mapping[str, Any]) -> str:
    """At which step of a press in steps the pulse is greatest; empty without steps or a pulse."""
    steps = [s for s in found.get("steps", ()) if s["pulse_n"] is not None]
    if not steps or not found.get("heart_rate_bpm"):
        return ""
    best = max(steps, key=lambda step: float(step["pulse_n"]))
    last = [step for step in steps if step["station"] == best["station"]][-1]
    differ_n = reach(math.hypot(best["pulse_sd_n"], last["pulse_sd_n"])) or 0.0
    beyond = (
        f"and {1e3 * last['pulse_n']:.3g} mN at the last"
        if best["pulse_n"] - last["pulse_n"] > differ_n
        else "and not less at the last: it may grow beyond"
    )
    return (
        f"of the steps the pulse is greatest, {1e3 * best['pulse_n']:.3g} mN, at "
        f"{best['force_n']:.3g} N, {best['depth_mm']:.2f} mm deep at station {best['station']}, "
        f"{beyond}"
    )


def reach(sd: float | None) -> float | None:
    """How far to either side of a number 95 of 100 lie, from its standard deviation."""
    return None if sd is None else NORMAL_95 * sd


def size_words(station: Mapping[str, Any]) -> tuple[str, str, str, str]:
    """Level and pulse of a station [Pa], each with its ± 95 %; what noise alone may have made of no
    pulse is shown as what the pulse is below."""
    level, pulse = station["baseline_pa"], station["pulse_pa"]
    below = station["pulse_below_pa"]
    return (
        number_words(level, ".1f"),
        number_words(reach(station["baseline_sd_pa"]), ".1f"),
        number_words(pulse, ".1f") if below is None else f"< {below:.1f}",
        number_words(reach(station["pulse_sd_pa"]), ".1f") if below is None else "",
    )


def number_words(value: float | None, form: str) -> str:
    """``value`` as the format ``form`` has it."""
    return "unknown" if value is None else format(value, form)


def _pascal(value: float | None, digits: int) -> str:
    return "an unknown one" if value is None else f"{plain(value, digits)} Pa"


def plain(value: float, digits: int) -> str:
    """To ``digits`` significant digits, without an exponent from 0.0001 to 10,000,000,000."""
    return f"{float(f'{value:.{digits}g}'):.10g}"


def percent(value: float | None) -> str:
    """A probability, never as 0 or 100 %."""
    if value is None:
        return "unknown"
    return f"{min(max(100 * value, 0.1), 99.9):.3g} %"


def assumption(found: Mapping[str, Any]) -> str:
    """What was assumed of several objects; empty for fewer than two."""
    if len(found["objects"]) < 2:
        return ""
    return (
        "each of several objects was looked for as if it lay alone in wide tissue: near others, or "
        "near the tissue's edge, places are off by more than their intervals say, and kinds are "
        "less certain than stated"
    )


def simulated_words(simulated: Sequence[str]) -> str:
    """What a reader must know first; empty for a wholly real run.

    ``simulated`` holds ``device.channel`` names; many channels of one device are counted.
    """
    devices: dict[str, list[str]] = {}
    for name in simulated:
        devices.setdefault(name.split(".", 1)[0], []).append(name)
    parts = [
        ", ".join(names) if len(names) <= MAX_NAMED else f"{device} ({len(names)} channels)"
        for device, names in devices.items()
    ]
    return f"SIMULATED: {', '.join(parts)}" if parts else ""
