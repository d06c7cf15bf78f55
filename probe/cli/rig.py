"""Before a scan: what would it take, can it see the pulse, are the devices well."""

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from probe.cli.errors import BAD_INPUT, FAULT
from probe.cli.say import Json, answer, answer_json

if TYPE_CHECKING:  # commands import what they need when they run
    from probe.doctor import Noise
    from probe.dryrun import Check

MARKS = {"ok": "ok     ", "warning": "warning", "fault": "FAULT  "}


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command()(doctor)


def doctor(
    rig: Annotated[
        Path | None,
        typer.Argument(metavar="[RIG.toml]", help="A rig whose devices to listen to."),
    ] = None,
    scene: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="What simulated devices feel.")
    ] = None,
    fallback: Annotated[
        Literal["virtual"] | None,
        typer.Option(help="Let simulated devices take the place of absent ones."),
    ] = None,
    json: Json = False,
) -> None:
    """Look at this machine and, with a rig, listen to its devices; nothing is moved."""
    from probe.devices import connect
    from probe.doctor import Noise, listen, machine
    from probe.dryrun import Check
    from probe.session import chosen, clock_for

    checks, noises = list(machine()), []
    if rig is not None:
        whole, _ = chosen(rig, scene)
        clock = clock_for(whole, real_time=False)
        with connect(whole, clock, fallback=fallback) as devices:
            checks += [Check("stand-in", "warning", note) for note in devices.notes]
            for found in listen(devices, clock):
                if isinstance(found, Noise):
                    noises.append(found)
                else:
                    checks.append(found)
    if json:
        answer_json({"checks": [asdict(c) for c in checks], "noise": [asdict(n) for n in noises]})
    else:
        show_checks(checks)
        show_noise(noises)
    raise typer.Exit(FAULT if any(check.level == "fault" for check in checks) else 0)


def show_dry_run(rig_file: Path | None, scene_name: str | None, out: Path, as_json: bool) -> int:
    """Check a scan without touching a device; the exit status."""
    from probe.dryrun import draw_path, dry_run
    from probe.session import chosen

    rig, scene = chosen(rig_file, scene_name)
    if scene is not None:
        from sim_backend.response import respond

        report = dry_run(rig, scene, out, respond)
    else:
        report = dry_run(rig, None, out)
    out.mkdir(parents=True, exist_ok=True)
    picture = out / "path.png"
    draw_path(rig, picture)
    if as_json:
        told: dict[str, Any] = report.as_json()
        answer_json(told | {"path_picture": picture})
    else:
        show_checks(report.checks)
        answer(f"The probe's way: {picture}")
        answer("The scan can go on." if report.can_scan else "The scan would fail.")
    return 0 if report.can_scan else BAD_INPUT


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
