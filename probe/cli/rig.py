"""Before a scan: what would it take, can it see the pulse, are the devices well."""

from pathlib import Path

import typer

from probe.cli.errors import BAD_INPUT
from probe.cli.say import answer, answer_json

MARKS = {"ok": "ok     ", "warning": "warning", "fault": "FAULT  "}


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""


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
        answer_json(report.as_json() | {"path_picture": picture})
    else:
        for check in report.checks:
            answer(f"{MARKS[check.level]} {check.name}: {check.text}")
        answer(f"The probe's way: {picture}")
        answer("The scan can go on." if report.can_scan else "The scan would fail.")
    return 0 if report.can_scan else BAD_INPUT
