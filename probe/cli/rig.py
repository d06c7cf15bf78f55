"""Before a scan: what would it take, can it see the pulse, are the devices well."""

from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from probe.cli.arguments import Fallback, SceneName
from probe.cli.errors import BAD_INPUT, FAULT
from probe.cli.say import Json, answer, answer_json, next_command

if TYPE_CHECKING:  # commands import what they need when they run
    from probe.checks.doctor import Noise
    from probe.checks.preflight import Check
    from probe.config.rig import Rig

MARKS = {"ok": "ok     ", "warning": "warning", "fault": "FAULT  "}


def doctor(
    rig: Annotated[
        Path | None,
        typer.Argument(metavar="[RIG.toml]", help="A rig whose devices to listen to."),
    ] = None,
    scene: SceneName = None,
    fallback: Fallback = None,
    json: Json = False,
) -> None:
    """Look at this machine and, with a rig, listen to its devices; nothing is moved."""
    from calibration import CalibrationError
    from drivers import ConfigError, DeviceFault
    from probe.checks.doctor import Noise, listen, machine
    from probe.checks.expected_press import SensorNoise, pulse_checks
    from probe.checks.preflight import TOGETHER, Check, device_checks
    from probe.checks.unusual import unusual
    from probe.config.devices import connect
    from probe.config.rig import RigError
    from probe.config.scan_plan import plan_for
    from probe.scan.session import clock_for, resolve_rig
    from sim_backend.models.station_response import respond

    checks, noises = list(machine()), []
    if rig is not None:
        whole, simulated = resolve_rig(rig, scene)
        clock = clock_for(whole, real_time=False)
        own, *_ = device_checks(whole, plan_for(whole), simulated)
        checks += [*unusual(whole, simulated), *own]
        # what is wrong with the plan only says nothing of the devices
        if not any(one.level == "fault" and one.name != TOGETHER for one in own):
            with ExitStack() as stack:
                try:
                    devices = stack.enter_context(connect(whole, clock, fallback=fallback))
                    checks += [Check("stand-in", "warning", note) for note in devices.notes]
                    for found in listen(devices, clock, whole):
                        if isinstance(found, Noise):
                            noises.append(found)
                        else:
                            checks.append(found)
                except DeviceFault as fault:  # absent or locked: the rest is said all the same
                    checks.append(Check(fault.device, "fault", fault.reason))
                except (ConfigError, RigError, CalibrationError) as error:
                    if str(error) not in (one.text for one in own):
                        checks.append(Check("devices", "fault", str(error)))
        forces = [n for n in noises if n.role == "force" and n.unit == "N"]
        measured = [SensorNoise(f"{n.sensor}.{n.channel}", n.std, n.rate_hz) for n in forces]
        checks += pulse_checks(whole, simulated, respond, measured)
    if json:
        answer_json({"checks": [asdict(c) for c in checks], "noise": [asdict(n) for n in noises]})
    else:
        show_checks(checks)
        show_noise(noises)
    raise typer.Exit(FAULT if any(check.level == "fault" for check in checks) else 0)


def plan(
    rig: Annotated[
        Path | None, typer.Argument(metavar="[RIG.toml]", help="A rig; default: simulated.")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="What is expected to lie beneath.")
    ] = None,
    can_i_see: Annotated[
        bool, typer.Option("--can-i-see", help="Say whether each sensor sees the scene's pulse.")
    ] = False,
    noise_mn: Annotated[
        float | None,
        typer.Option(metavar="MN", help="A sensor's rms noise [mN], if known better."),
    ] = None,
    json: Json = False,
) -> None:
    """Where a scan would go and how long it takes; with --can-i-see, what its sensors can see."""
    if noise_mn is not None and not noise_mn >= 0:
        raise typer.BadParameter(f"--noise-mn {noise_mn:g}: must be 0 or more")
    from drivers import find_driver
    from probe.checks.dry_run import dry_run
    from probe.checks.expected_press import known_noise, pulse_checks
    from probe.config.rig import RASTER
    from probe.config.scan_plan import plan_for
    from probe.core.places import has_rows
    from probe.scan.session import resolve_rig
    from sim_backend.models.station_response import respond

    whole, simulated = resolve_rig(rig, scene)
    press = plan_for(whole)
    places = press.places
    if not can_i_see:
        checks = list(dry_run(whole, simulated, Path(), respond).checks)
    else:
        for device in whole.sensor:
            find_driver("sensors", device.driver)  # of one that is none nothing can be said
        known = [known_noise(device) for device in whole.sensor]
        if noise_mn is not None:
            known = [one._replace(noise_n=1e-3 * noise_mn) for one in known]
        checks = pulse_checks(whole, simulated, respond, known)
    if json:
        stations = [[1e3 * p.x_m, 1e3 * p.y_m] for p in places]
        answer_json({"stations_mm": stations, "checks": [asdict(c) for c in checks]})
        return
    how = f"{1e3 * press.indentation_m:g} mm in {press.ramp_s:g} s, held {press.hold_s:g} s"
    if press.force_n is not None:
        deepest = f"at most {1e3 * press.indentation_m:g} mm deep"
        how = f"to {press.force_n:g} N, {deepest}, held {press.hold_s:g} s"
    if press.steps:
        how += f", and {press.step_hold_s:g} s at {press.steps} steps before"
    spans = [
        f"{axis} = {1e3 * min(at):g}{f' to {1e3 * max(at):g}' if max(at) > min(at) else ''} mm"
        for axis, at in (("x", [p.x_m for p in places]), ("y", [p.y_m for p in places]))
        if axis == "x" or has_rows(1e3 * y for y in at)
    ]
    at_most = "" if whole.scan.planner == RASTER else "at most "
    presses = f"{at_most}{len(places)} station{'s' * (len(places) > 1)}"
    answer(f"{presses}, {', '.join(spans)}; {how}")
    show_checks(checks)


def show_dry_run(
    rig_file: Path | None, scene_name: str | None, out: Path, as_json: bool,
    changes: Mapping[str, str],
) -> int:  # fmt: skip
    """Check a scan without touching a device; the exit status."""
    from probe.config.changed_rig import changed
    from probe.scan.session import resolve_rig

    rig, scene = resolve_rig(rig_file, scene_name)
    rig, scene = resolve_rig(changed(rig, changes), None) if changes else (rig, scene)

    # what a wrong file's user would wait for
    from drivers import MissingExtra
    from probe.checks.dry_run import dry_run
    from probe.checks.tip_path import draw_path

    if scene is not None:
        from sim_backend.models.station_response import respond

        report = dry_run(rig, scene, out, respond)
    else:
        report = dry_run(rig, None, out)
    picture: Path | None = out / "path.png"
    said = f"The probe's way: {picture}"
    try:
        out.mkdir(parents=True, exist_ok=True)
        draw_path(rig, out / "path.png")
    except (MissingExtra, OSError) as error:  # the checks need no picture
        if isinstance(error, OSError) and report.can_scan:  # nor can a scan write there
            raise
        picture, said = None, f"The probe's way is not drawn: {error}"
    if as_json:
        dry_run_json: dict[str, Any] = report.as_json()
        answer_json(dry_run_json | {"path_picture": picture})
    else:
        show_checks(report.checks)
        answer(said)
        answer(verdict(rig_file, rig, can_scan=report.can_scan))
    return 0 if report.can_scan else BAD_INPUT


def verdict(rig_file: Path | None, rig: "Rig", *, can_scan: bool) -> str:
    """What a dry run comes to. It touches no device, so real ones may still be absent."""
    if not can_scan:
        return "The scan would fail."
    if rig_file is None or not rig.real:
        return "The scan can go on."
    return f"The scan can go on if its devices answer: {next_command('doctor', rig_file)}"


def show_checks(checks: "Iterable[Check]") -> None:
    """One line per check."""
    for check in checks:
        answer(f"{MARKS[check.level]} {check.name}: {check.text}")


def show_noise(noises: "Iterable[Noise]") -> None:
    """One line per channel."""
    for noise in noises:
        simulated = "SIMULATED " if noise.simulated else ""
        answer(
            f"noise   {noise.sensor}.{noise.channel}: {simulated}{noise.std:.3g} {noise.unit} rms, "
            f"steps of {noise.step:.3g} {noise.unit}, {noise.rate_hz:.0f} Hz"
        )
