"""What a press will give, before a scan: whether its force stays below the limit, and whether each
sensor sees the pulse in it.
"""

import math
from collections.abc import Iterable
from contextlib import suppress
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from drivers import ConfigError
from drivers.core.registry import settings_of
from probe.checks.preflight import Check
from probe.checks.touch_noise import force_in_noise, touch_in_noise
from probe.config.rig import Device, Rig, pair
from probe.config.scan_plan import plan_for
from probe.config.snapshot import face_mm2_of
from probe.core.contact_stress import square_metres
from probe.detection.pulse.hold_limits import MIN_SAMPLES, SETTLING_S, SETTLING_SAMPLES
from probe.detection.pulse.hold_samples import BIN_S, MIN_BINS
from probe.detection.sensitivity import MEAT, in_words, visibility
from probe.planning.plan import Place, Plan
from sim_backend.phantom.phantom import Respond
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.slicing import section_at
from sim_backend.scene.waves import load_wave

# The paper's beat of 0.825 s: what a hold that would show the pulse is told in beats by.
USUAL_BEAT_HZ = 1.2
# The weakest 5 % of 44 records of five volunteers' radial pulses by tonometry (microsoft's
# aurorabp-sample-data), trough to crest within 1.5 s, are below 1340 Pa; half are below 8600.
WEAK_PULSE_PA = 1300.0
# Share of the force limit from which on another station may pass it: one is solved, and over the
# stations of TIHA and TIT the force differs by 10 % (0.83 to 0.91 N). Twice that is left.
NEAR_LIMIT = 0.8

# (rms noise N, rate Hz) of sensors whose rig settings do not say, as in the table of
# docs/how-to/rig.md: netft is the ATI Gamma there. The noise of ur is assumed: doctor measures it.
KNOWN_NOISE = {
    "ft300": (0.1, 100.0),
    "ur": (0.5, 500.0),
    "netft": (6.25e-3, 1000.0),
    "virtual": (0.5e-3, 500.0),
}


class SensorNoise(NamedTuple):
    """A sensor's rms noise [N], NaN if unknown, its rate, and how to make a noise known."""

    name: str
    noise_n: float
    rate_hz: float
    advice: str = ""


class ExpectedPress(NamedTuple):
    """The greatest force [N] of one simulated press, how deep it ends [m], and the pulse in it,
    trough to crest; None without an artery."""

    x_m: float
    force_n: float
    depth_m: float
    pulse_n: float | None


def pulse_checks(
    rig: Rig, scene: Scene | None, respond: Respond | None, sensors: Iterable[SensorNoise]
) -> list[Check]:
    """Whether each sensor sees the expected pulse in one hold, by its known or measured noise,
    whether the first can tell a touch from it, and whether the press stays below the force limit.

    With a ``scene`` and ``respond`` a press is solved at the station nearest to an artery, else
    to an inclusion; without, the weakest measured radial pulses are taken, and no force is known.
    """
    checks: list[Check] = []
    if scene is not None and respond is not None:
        pressed, check = _expected_press(rig, scene, respond)
        checks.append(check)
        pulse_n, source = _solved_pulse(scene, pressed)
    else:
        pulse_n, source = _usual_pulse(rig)
    beat_hz = scene.pulse.rate_bpm / 60 if scene is not None else USUAL_BEAT_HZ
    face_m2 = square_metres(face_mm2_of(rig, scene))
    if scene is None:
        relaxation = MEAT
    else:  # a lone vessel does not relax
        relaxation = scene.tissue.relaxation if scene.tissue is not None else ()
    columns, rows = pair(rig.scan.stations, 1)
    presses = int(columns * rows * rig.scan.repeats)
    for n, (name, noise_n, rate_hz, advice) in enumerate(sensors):
        touch_n = rig.scan.touch_n if n == 0 else None
        if touch_n and (why := touch_in_noise(name, noise_n, rate_hz, touch_n)) is not None:
            checks.append(Check("touch", "fault", why))
        rises_n = [b - a for a, b in pairwise((0.0, *rig.scan.forces_n))] if n == 0 else []
        why = force_in_noise(name, noise_n, rate_hz, min(rises_n)) if rises_n else None
        if why is not None:
            checks.append(Check("force", "fault", why))
        title = f"pulse on {name}"
        if pulse_n is None:
            checks.append(Check(title, "ok", f"nothing to compare with: {source}"))
        elif not math.isfinite(noise_n):
            checks.append(Check(title, "warning", f"this sensor's noise is not known{advice}"))
        elif (least_s := shortest_hold_s(rate_hz)) > rig.scan.hold_s:
            text = f"no: scan.hold_s = {rig.scan.hold_s:g} is too short to judge a press by; "
            text += f"at least {least_s:.2g} s are needed, two heartbeats to see a pulse well"
            checks.append(Check(title, "warning", text))
        else:
            seen = visibility(
                noise_n, rate_hz, rig.scan.hold_s, pulse_n, beat_hz, presses, relaxation
            )
            level: Literal["ok", "warning"] = "ok" if seen.visible else "warning"
            checks.append(Check(title, level, f"{in_words(seen, face_m2)} ({source})"))
    return checks


def shortest_hold_s(rate_hz: float) -> float:
    """The hold [s] that leaves as many samples as detection asks of a press."""
    step_s = 1 / rate_hz
    settling_s = max(SETTLING_S, SETTLING_SAMPLES * step_s)
    return settling_s + max(MIN_SAMPLES * step_s, MIN_BINS * max(BIN_S, step_s))


def known_noise(device: Device) -> SensorNoise:
    """By the rig's settings or the known table."""
    noise_n, rate_hz = KNOWN_NOISE.get(device.driver, (math.nan, 100.0))
    noise_n = 1e-3 * float(device.settings.get("noise_mn", 1e3 * noise_n))
    if "array" in device.settings:
        noise_n = math.nan  # of a taxel, in pascals
    rate_hz = float(device.settings.get("rate_hz", rate_hz))
    return SensorNoise(device.driver, noise_n, rate_hz, _advice(device.driver))


def _advice(driver: str) -> str:
    """How to make a sensor's noise known: by a key where its driver takes one."""
    with suppress(ConfigError):  # a broken driver is a fault of its own
        if "noise_mn" in settings_of("sensors", driver).model_fields:
            return "; give noise_mn in the sensor's table"
    return (
        "; `palpate doctor RIG` measures it with the sensor unloaded, and `palpate plan RIG "
        "--can-i-see --noise-mn MN` takes one that you know"
    )


def _usual_pulse(rig: Rig) -> tuple[float | None, str]:
    """Peak-to-peak force [N] of the pulse, and where the figure comes from."""
    if rig.face_mm2 is None:
        return None, "no scene and no face_mm2"
    return 1e-6 * rig.face_mm2 * WEAK_PULSE_PA, "the weakest 5 % of radial pulses"


def _solved_pulse(scene: Scene, pressed: ExpectedPress | None) -> tuple[float | None, str]:
    """The same, of a scene."""
    if not scene.arteries:
        return None, f"scene {scene.name} has no artery"
    if pressed is None:
        return None, f"the press into scene {scene.name} has no answer"
    return pressed.pulse_n, f"scene {scene.name} at x = {1e3 * pressed.x_m:g} mm"


def _expected_press(rig: Rig, scene: Scene, respond: Respond) -> tuple[ExpectedPress | None, Check]:
    """The press of one station, and whether the force limit lets it pass."""
    from sim_backend.fem.newton import CannotSolve

    plan = plan_for(rig)
    place = _nearest(plan, scene)
    where = f"{1e3 * plan.indentation_m:g} mm deep at x = {1e3 * place.x_m:g} mm"
    sure = _is_measured_as_solved(rig, scene)
    level: Literal["ok", "warning", "fault"] = "fault" if sure else "warning"
    try:
        pressed = _solved_press(plan, place, scene, respond)
    except (CannotSolve, SceneError) as error:
        return None, Check("force", level, f"not known {where} in scene {scene.name}: {error}")
    limit_n = rig.safety.max_force_n
    if plan.force_n is not None:
        return pressed, _force_reached(plan.force_n, pressed, scene.name)
    text = f"{pressed.force_n:.3g} N {where} in scene {scene.name}"
    text += " at systole" if scene.arteries else ""
    text += f"; the limit is safety.max_force_n = {limit_n:g} N"
    if pressed.force_n <= NEAR_LIMIT * limit_n:
        return pressed, Check("force", "ok", text)
    if pressed.force_n <= limit_n:
        level, text = "warning", f"{text}, and another station may need more"
    text += ": press less deep (scan.indentation_mm), or allow more where that is safe"
    return pressed, Check("force", level, text)


def _force_reached(asked_n: float, pressed: ExpectedPress, scene: str) -> Check:
    where = f"{1e3 * pressed.depth_m:.2f} mm deep at x = {1e3 * pressed.x_m:g} mm in scene {scene}"
    if pressed.force_n >= asked_n:
        return Check("force", "ok", f"{asked_n:g} N are reached {where}")
    text = f"{asked_n:g} N are not reached: {pressed.force_n:.3g} N {where}, where the "
    text += "press would be held; ask for less, or allow more depth (scan.indentation_mm)"
    return Check("force", "warning", text)


def _nearest(plan: Plan, scene: Scene) -> Place:
    """The station nearest to the first artery, else to the first inclusion, else the middle one."""
    if not scene.inclusion:
        return plan.places[len(plan.places) // 2]
    one = (scene.arteries or scene.inclusion)[0]
    z_mm = getattr(one, "z_mm", None)  # a ball's; a vessel runs through all sections

    def off_mm(place: Place) -> float:
        y_mm = 1e3 * place.y_m
        beside_mm = 1e3 * place.x_m - one.centre_mm(y_mm)[0]
        return math.hypot(beside_mm, 0.0 if z_mm is None else y_mm - z_mm)

    return min(plan.places, key=off_mm)


def _solved_press(plan: Plan, place: Place, scene: Scene, respond: Respond) -> ExpectedPress:
    wave = load_wave(scene.pulse)
    beat = wave.pressure_pa(np.linspace(0, wave.period_s, 200))
    section = respond(section_at(scene, 1e3 * place.y_m), place.x_m, plan.indentation_m)
    depth = np.linspace(0.0, plan.indentation_m, 201)
    each = np.stack([section.force_n(depth, np.full(201, at))
                     for at in (beat.min(), beat.max())])  # fmt: skip
    most = each.max(axis=0)
    end = 200 if plan.force_n is None else min(int(np.searchsorted(most, plan.force_n)), 200)
    low, high = each[:, end].tolist()
    pulse_n = abs(high - low) if scene.arteries else None  # beside a vessel the crest may be lower
    return ExpectedPress(place.x_m, float(most[end]), float(depth[end]), pulse_n)


def _is_measured_as_solved(rig: Rig, scene: Scene) -> bool:
    """Whether a simulated sensor measures the solved force: the tissue does not relax meanwhile,
    its surface is where the plan has it, the rig is not compliant, and the sensor reads newtons."""
    virtual = [sensor for sensor in rig.sensor if sensor.driver == "virtual"]
    return (
        any(sensor.settings.get("gain", 1.0) == 1.0 for sensor in virtual)
        and not (scene.tissue is not None and scene.tissue.relaxation)
        and not (rig.scene is not None and rig.scene.surface_mm is not None)
        and "stiffness_n_mm" not in rig.stage.settings
    )
