"""One draw of each calibration: a device with a known truth, its noisy readings, and the fit."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from calibration import (
    Fit,
    fit_axes,
    fit_compliance,
    fit_force,
    fit_gravity,
    fit_heart,
    fit_latency,
    fit_surface,
    fit_tare,
    fit_taxels,
    fit_tissue,
    fit_tool,
)
from drivers.core.arrays import Array, Bools
from probe.calibrate.tissue_force import Forward, force_of_modulus
from sim_backend.models.press import press
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import load_scene

Rng = np.random.Generator

FT300_N, FT300_HZ = 0.1, 100.0  # Robotiq FT300-S
HEX_N, HEX_HZ = 0.2, 500.0  # OnRobot HEX-E
NANO_N = 1 / 320  # ATI Nano17
POSE_M = 30e-6  # the repeatability that the maker of the UR5e states
TOUCH_M = 20e-6
DEEPEST_M = {"small": 1.0e-3, "finite": 2.5e-3}  # small strain is refused deeper than 1.6 mm here
RR_SD_S = 0.035


@dataclass(frozen=True)
class Trial:
    """``draw`` gives an error in the target's unit and whether each interval holds the truth."""

    name: str
    target: str
    limit: float | None
    draw: Callable[[Rng], tuple[float, Bools]]


def holds(fit: Fit, truth: Array) -> Bools:
    """Whether each 95 % interval of a fit holds its true value."""
    low, high = fit.interval().T
    return np.asarray((low <= truth) & (truth <= high))


def force(rng: Rng) -> tuple[Array, Array, Array, Array]:
    """Three axes loaded one by one, up and down, each reading the mean of a second."""
    steps = np.concatenate([np.linspace(-20, 20, 9), np.linspace(20, -20, 9)[1:]])
    loads = np.concatenate([np.outer(steps, axis) for axis in np.eye(3)])
    truth = np.diag(rng.uniform(0.8, 1.2, 3)) @ (np.eye(3) + 0.03 * rng.standard_normal((3, 3)))
    offset = rng.uniform(-2, 2, 3)
    noise = FT300_N / np.sqrt(FT300_HZ) * rng.standard_normal(loads.shape)
    return loads, truth, offset, loads @ truth.T + offset + noise


def force_error(rng: Rng) -> tuple[float, Bools]:
    loads, truth, offset, raw = force(rng)
    found = fit_force(raw, loads)
    error = found.load(loads @ truth.T + offset) - loads
    wanted = np.column_stack([offset, truth]).ravel()
    return 100 * float(np.abs(error).max()) / 40.0, holds(found.fit, wanted)


def crosstalk_error(rng: Rng) -> tuple[float, Bools]:
    loads, truth, offset, raw = force(rng)
    found = fit_force(raw, loads)
    wanted = truth / np.diag(truth)[:, None]
    inside = holds(found.fit, np.column_stack([offset, truth]).ravel()).reshape(3, 4)[:, 1:]
    return 100 * float(np.abs(found.crosstalk - wanted).max()), inside[~np.eye(3, dtype=bool)]


def bent_error(rng: Rng) -> tuple[float, Bools]:
    """Hysteresis and linearity figures of a sensor that has both, 0.4 % and 0.3 % of its span."""
    steps = np.tile(np.concatenate([np.linspace(0, 20, 9), np.linspace(20, 0, 9)[1:]]), 4)
    up = np.concatenate([[1.0], np.sign(np.diff(steps))])
    arch = 4 * (steps / 20) * (1 - steps / 20)
    gap, bow = 0.004 * 20, 0.003 * 20
    raw = steps + up * gap / 2 * arch + bow * arch
    raw = raw + FT300_N / np.sqrt(FT300_HZ) * rng.standard_normal(len(steps))
    found = fit_force(raw, steps)
    return 100 * abs(found.hysteresis - 0.004), np.empty(0, bool)


def taxel_error(rng: Rng) -> tuple[float, Bools]:
    """28 taxels, one dead, pressed evenly at eight levels."""
    pressure = np.repeat(np.linspace(0, 40e3, 8), 5)
    gain, offset = 0.05 * rng.uniform(0.8, 1.2, 28), rng.uniform(50, 150, 28)
    gain[3] = 0.0
    raw = offset + np.outer(pressure, gain) + 2 * rng.standard_normal((40, 28))
    found = fit_taxels(raw, pressure)
    good = np.arange(28) != 3
    error = found.pressure(offset + np.outer(pressure, gain))[:, good] - pressure[:, None]
    inside = holds(found.fit, np.column_stack([offset, gain]).ravel())
    assert found.dead[3] == 1.0
    assert found.dead.sum() == 1.0
    return 100 * float(np.abs(error).max()) / 40e3, inside


def gravity_error(rng: Rng) -> tuple[float, Bools]:
    """A tool of 0.2 to 0.6 kg in eight orientations; what is left of its weight."""
    turns = Rotation.random(8, random_state=rng).as_matrix()
    mass, centre = rng.uniform(0.2, 0.6), rng.uniform(-0.03, 0.05, 3)
    bias = np.concatenate([rng.uniform(-2, 2, 3), rng.uniform(-0.05, 0.05, 3)])
    weight = np.swapaxes(turns, 1, 2) @ np.array([0, 0, -9.80665]) * mass
    clean = np.hstack([weight, np.cross(centre, weight)]) + bias
    sd = np.repeat([FT300_N, 0.1 * FT300_N], 3) / np.sqrt(FT300_HZ)
    found = fit_gravity(clean + sd * rng.standard_normal((8, 6)), turns)
    left = found.load(clean, turns)[:, :3]
    truth = np.concatenate([[mass], centre, bias])
    return float(np.abs(left).max()), holds(found.fit, truth)


def tool_error(rng: Rng) -> tuple[float, Bools]:
    """Sixteen poses, turned by up to 30 degrees about each axis."""
    tip = np.array([*rng.uniform(-0.01, 0.01, 2), rng.uniform(0.08, 0.2)])
    pivot = rng.uniform(-0.4, 0.4, 3)
    turns = Rotation.from_rotvec(rng.uniform(-0.52, 0.52, (16, 3))).as_matrix()
    flange = pivot - turns @ tip + POSE_M * rng.standard_normal((16, 3))
    found = fit_tool(flange, turns)
    error = 1e3 * float(np.linalg.norm(found.tip_m - tip))
    return error, holds(found.fit, np.concatenate([tip, pivot]))


def axes_error(rng: Rng) -> tuple[float, Bools]:
    read = rng.uniform(0, 0.1, (15, 3))
    matrix = np.eye(3) + 3e-3 * rng.standard_normal((3, 3))
    shift = rng.uniform(-0.01, 0.01, 3)
    found = fit_axes(read, read @ matrix.T + shift + TOUCH_M * rng.standard_normal((15, 3)))
    corners = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    error = found.true(corners) - (corners @ matrix.T + shift)
    centred = np.column_stack([matrix, matrix @ read.mean(axis=0) + shift])
    return 1e3 * float(np.sqrt(np.mean(error**2))), holds(found.fit, centred.ravel())


def surface_error(rng: Rng) -> tuple[float, Bools]:
    """A tilted plane touched at twelve places, two of them wrong by 1 to 5 mm."""
    slope = rng.uniform(-0.1, 0.1, 2)
    xy = rng.uniform(0, 0.06, (12, 2))
    z = 0.002 + xy @ slope + TOUCH_M * rng.standard_normal(12)
    z[rng.choice(12, 2, replace=False)] += rng.choice([-1, 1], 2) * rng.uniform(1e-3, 5e-3, 2)
    found = fit_surface(np.column_stack([xy, z]))
    at = np.stack(np.meshgrid(*2 * [np.linspace(0, 0.06, 9)]), axis=-1).reshape(-1, 2)
    error = found.heights(*at.T) - (0.002 + at @ slope)
    truth = np.array([0.002 + found.centre_m @ slope, *slope])
    return 1e3 * float(np.sqrt(np.mean(error**2))), holds(found.fit, truth)


def chirp_error(rng: Rng) -> tuple[float, Bools]:
    """A chirp of 1 to 20 Hz, 0.2 mm on a spring of 10 N/mm; clocks differ by up to 50 ppm."""
    return _delay(rng, lambda t: 0.2e-3 * np.sin(2 * np.pi * (t + 0.95 * t**2)), 1e4, 10.0)


def tap_error(rng: Rng) -> tuple[float, Bools]:
    """Twenty taps from 1 mm in the air to 5 N, in at 7 mm/s and out at 20 mm/s; the stage takes
    20 ms to change its speed."""

    def taps(t: Array) -> Array:
        corners = 1e-3 * np.array([-1, -1, 1, 1, -1, -1])
        soft = np.mod(t[:, None] + np.linspace(-0.01, 0.01, 41), 1.0)
        return np.asarray(np.interp(soft, [0, 0.2, 0.5, 0.7, 0.8, 1.0], corners).mean(axis=1))

    return _delay(rng, taps, 5e3, 20.0)


def _delay(
    rng: Rng, course: Callable[[Array], Array], stiffness_n_m: float, span_s: float
) -> tuple[float, Bools]:
    delay, skew = rng.uniform(-0.02, 0.06), rng.uniform(-50e-6, 50e-6)
    stage_s = np.arange(0, span_s, 1 / 500)
    taken_s = np.arange(0, span_s, 1 / HEX_HZ) + rng.uniform(0, 1 / HEX_HZ)
    pressed = course(taken_s)
    force = stiffness_n_m * (np.maximum(pressed, 0) if pressed.min() < -0.6e-3 else pressed)
    force = force + HEX_N * rng.standard_normal(len(taken_s))
    stamp_s = taken_s + delay + skew * (taken_s - 5.0)
    found = fit_latency(stage_s, course(stage_s), stamp_s, force)
    true_delay = delay + skew * (found.middle_s - delay - 5.0) / (1 + skew)
    truth = np.array([true_delay, skew / (1 + skew)])
    return 1e3 * (found.delay_s - true_delay), holds(found.fit, truth)


def stiffness_error(rng: Rng) -> tuple[float, Bools]:
    """A ramp of two seconds to 10 N on a rigid block."""
    stiffness, contact = rng.uniform(5e3, 50e3), rng.uniform(-2e-5, 5e-5)
    depth = np.linspace(-0.2, 1.0, 1000) * 10 / stiffness
    force = stiffness * np.maximum(depth - contact, 0) + HEX_N * rng.standard_normal(1000)
    found = fit_compliance(depth, force)
    return 100 * (found.stiffness_n_m / stiffness - 1), holds(
        found.fit, np.array([stiffness, contact, 0.0])
    )


@lru_cache(maxsize=2)
def solved(model: str) -> tuple[Forward, float, PchipInterpolator]:
    """The inversion's forward model, and the force of 50 kPa over depth by another solution."""
    scene = load_scene("TI")
    deepest = DEEPEST_M[model]
    depths = np.linspace(0, 1.02 * deepest, 26)
    if model == "finite":
        other = respond(scene, 0.032, float(depths[-1])).force_n(depths, np.zeros(1))
    else:
        per_mm = [
            press(scene, 32.0, 1e3 * d, model="small", accuracy_pct=0.2).states[0].force_n_per_mm
            for d in depths[1:]
        ]
        other = scene.indenter.length_mm * np.array([0.0, *per_mm])
    return *force_of_modulus(scene, deepest, model), PchipInterpolator(depths, other)


def modulus_error(model: str, noise_n: float) -> Callable[[Rng], tuple[float, Bools]]:
    """A ramp of a second at 500 Hz on 20 to 80 kPa; contact known to 0.1 mm."""

    def draw(rng: Rng) -> tuple[float, Bools]:
        forward, off, force_n = solved(model)
        modulus, contact = rng.uniform(20e3, 80e3), rng.uniform(0, 1e-4)
        depth = np.linspace(0, DEEPEST_M[model], 500)
        clean = modulus / 50e3 * force_n(np.maximum(depth - contact, 0))
        force = clean + noise_n * rng.standard_normal(500)
        found = fit_tissue(depth, force, forward, [50e3], forward_off=off)
        truth = np.array([np.log(modulus), 1e3 * contact])
        return 100 * (float(found.modulus_pa[0]) / modulus - 1), holds(found.fit, truth)

    return draw


def relaxation_error(rng: Rng) -> tuple[float, Bools]:
    """The same ramp, then a hold of six seconds; one Prony term. The error is the weight's."""
    forward, off, force_n = solved("finite")
    modulus, g, tau = rng.uniform(20e3, 80e3), rng.uniform(0.1, 0.4), rng.uniform(0.4, 1.5)
    time_s = np.arange(0, 7, 0.01)
    deepest = DEEPEST_M["finite"]
    depth = np.minimum(time_s, 1.0) * deepest
    elastic = modulus / 50e3 * force_n(depth)
    fine_s = np.arange(0, 7, 0.0005)
    fine = modulus / 50e3 * force_n(np.minimum(fine_s, 1) * deepest)
    memory = np.zeros(len(fine_s))
    for n in range(1, len(fine_s)):
        memory[n] = (memory[n - 1] + fine[n] - fine[n - 1]) * np.exp(-0.0005 / tau)
    force = elastic - g * (elastic - np.interp(time_s, fine_s, memory))
    force = force + NANO_N * rng.standard_normal(len(time_s))
    found = fit_tissue(depth, force, forward, [50e3], time_s=time_s, relaxation_start_s=[0.8],
                       forward_off=off)  # fmt: skip
    truth = np.array([np.log(modulus), 0.0, g, np.log(tau)])
    return 100 * (float(found.relaxation_g[0]) - g), holds(found.fit, truth)


def rate_error(rng: Rng) -> tuple[float, Bools]:
    """Thirty beats of a tonometer, each of its own length; the error is against what was
    recorded, the interval about the heart's usual rate."""
    usual_s = rng.uniform(0.6, 1.1)
    lengths = np.maximum(usual_s + RR_SD_S * rng.standard_normal(34), 0.3)
    feet = np.concatenate([[0.0], np.cumsum(lengths)])
    t = np.arange(feet[1], feet[-2], 0.01)
    phase = np.interp(t, feet, np.arange(len(feet)))
    wave = 90 + 30 * shape(np.mod(phase, 1)) + 0.3 * rng.standard_normal(len(t))
    found = fit_heart(t, wave, (120.0, 80.0), is_pressure=True)
    truth = 60 / float(lengths[1:-1].mean())
    return 100 * (found.rate_bpm / truth - 1), holds(found.fit, np.array([60 / usual_s]))


def shape(phase: Array) -> Array:
    """A pressure wave from 0 to 1: a fast rise, a slow fall with a notch."""
    return np.asarray(np.interp(phase, [0, 0.15, 0.35, 0.42, 0.5, 1], [0, 1, 0.55, 0.45, 0.5, 0]))


def wave_error(rng: Rng) -> tuple[float, Bools]:
    """The wave's rms error over a beat, mmHg of 40, at the best shift."""
    lengths = np.maximum(0.85 + RR_SD_S * rng.standard_normal(34), 0.3)
    feet = np.concatenate([[0.0], np.cumsum(lengths)])
    t = np.arange(feet[1], feet[-2], 0.01)
    phase = np.interp(t, feet, np.arange(len(feet)))
    wave = shape(np.mod(phase, 1)) + 0.01 * rng.standard_normal(len(t))
    found = fit_heart(t, wave, (120.0, 80.0), is_pressure=True).wave_mmhg
    beat = np.linspace(0, 1, len(found), endpoint=False)
    off = [
        float(np.sqrt(np.mean((found - 80 - 40 * shape(np.mod(beat - s, 1))) ** 2)))
        for s in np.linspace(-0.1, 0.1, 41)
    ]
    return min(off), np.empty(0, bool)


def tare_error(rng: Rng) -> tuple[float, Bools]:
    """A minute of a drifting sensor; what is left a minute later, N."""
    bias, drift = rng.uniform(-2, 2), rng.uniform(-0.01, 0.01)
    t = np.arange(0, 60, 1 / FT300_HZ)
    found = fit_tare(t, bias + drift * t + FT300_N * rng.standard_normal(len(t)))
    left = found.zeroed(np.array([[bias + drift * 120.0]]), np.array([120.0]))
    return float(left[0, 0]), holds(found.fit, np.array([bias + drift * found.at_s, drift]))


TRIALS = (
    Trial("force, 3 axes, FT300", "0.5 % of full scale", 0.5, force_error),
    Trial("crosstalk", "0.2 %", 0.2, crosstalk_error),
    Trial("hysteresis of 0.4 % (its figure, % of span)", "–", None, bent_error),
    Trial("28 taxels, one dead (% of span)", "–", None, taxel_error),
    Trial("gravity, 8 orientations (N left)", "–", None, gravity_error),
    Trial("tare and drift, a minute on (N)", "–", None, tare_error),
    Trial("tool centre point, 16 poses, UR5e", "0.1 mm", 0.1, tool_error),
    Trial("axis errors, 15 points (mm)", "–", None, axes_error),
    Trial("surface, 12 touches, 2 outliers", "0.05 mm rms", 0.05, surface_error),
    Trial("latency by chirp of 10 s, HEX 500 Hz", "0.2 ms", 0.2, chirp_error),
    Trial("latency by 20 taps, HEX 500 Hz", "0.2 ms", 0.2, tap_error),
    Trial("rig stiffness, HEX", "1 %", 1.0, stiffness_error),
    Trial("modulus, linear to 1 mm, Nano17", "2 %", 2.0, modulus_error("small", NANO_N)),
    Trial("modulus, finite strain to 2.5 mm, Nano17", "2 %", 2.0, modulus_error("finite", NANO_N)),
    Trial("modulus, finite strain to 2.5 mm, FT300", "2 %", 2.0, modulus_error("finite", FT300_N)),
    Trial("relaxation, finite (weight, %)", "–", None, relaxation_error),
    Trial("heart rate (%)", "–", None, rate_error),
    Trial("heart wave (mmHg of 40)", "–", None, wave_error),
)
