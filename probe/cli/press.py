"""One press into the phantom: force, pulse, contact, and what they change with."""

from pathlib import Path
from typing import Annotated, Any

import typer

from probe.cli.arguments import SCENE, Accuracy, rows_columns
from probe.cli.say import Json, answer, answer_json, inform, plain


def press(
    scene: Annotated[str, SCENE],
    x: Annotated[float, typer.Option(metavar="MM", help="Where along the surface [mm].")],
    depth: Annotated[float, typer.Option(metavar="MM", help="How deep [mm].")],
    pressure: Annotated[
        list[float] | None,
        typer.Option(
            metavar="MMHG",
            help="Pressure in the lumen [mmHg]; may be given again. Without it the scene's "
            "diastolic and systolic.",
        ),
    ] = None,
    accuracy: Accuracy = 1.0,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="small or finite (strain, of a plane scene), axisymmetric or solid (of a solid "
            "scene), auto; chosen if not given.",
        ),
    ] = None,
    deck: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.inp", help="Also write the press as an Abaqus or CalculiX deck."
        ),
    ] = None,
    feb: Annotated[
        Path | None, typer.Option(metavar="FILE.feb", help="Also write the press for FEBio.")
    ] = None,
    vtu: Annotated[
        Path | None, typer.Option(metavar="FILE.vtu", help="Also write the solution for ParaView.")
    ] = None,
    gradient: Annotated[
        bool,
        typer.Option(
            "--gradient", help="Also say how force and pulse change with each number of the scene."
        ),
    ] = False,
    taxels: Annotated[
        str | None,
        typer.Option(
            metavar="ROWSxCOLUMNS",
            help="Also say the force on each taxel of an array in the finger: rows along the "
            "vessels, columns across.",
        ),
    ] = None,
    pitch: Annotated[
        float | None,
        typer.Option(
            metavar="MM", help="Size of a taxel [mm]; without it they share the finger's face."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Press once into a scene and print force, contact stress, pulse and contact."""
    from probe.cli.progress import solving
    from sim_backend.models.press import press as press_once
    from sim_backend.models.table import names
    from sim_backend.scene.odd_values import odd_values
    from sim_backend.scene.scene_file import load_scene
    from sim_backend.scene.waves import load_wave

    chosen = {} if model is None else {"model": model}
    pressed_into = load_scene(scene)
    load_wave(pressed_into.pulse)  # so that what a scan refuses is refused here too
    for doubt in odd_values(pressed_into):
        inform(f"warning: {doubt}")
    if deck or feb:  # neither CalculiX nor FEBio knows a solid's wedges of 18 nodes
        pressed_into.need_section("--deck and --feb write")
    for option, path, mark in (
        ("--deck", deck, b" mm thick. "),
        ("--feb", feb, b"<febio_spec"),
        ("--vtu", vtu, b"created by meshio"),
    ):
        if path is not None:
            several = path.parent.glob(f"{path.stem}-[0-9]*{path.suffix}") if vtu == path else ()
            for file in (path, *several):
                check_out(option, file, mark)
    array = taxel_array(taxels, pitch)
    with solving() as show:
        pressed = press_once(
            pressed_into, x, depth, pressure or None, accuracy_pct=accuracy, solving=show,
            gradient=gradient, taxels=array, **chosen,
        )  # fmt: skip
    pressures = [state.pressure_mmhg for state in pressed.states]
    if deck is not None:
        from sim_backend.fem.io.deck import write_deck

        write_deck(pressed.scene, x, depth, pressures, deck)
        inform(f"deck: {deck}")
    if feb is not None:
        from sim_backend.fem.io.feb import write_feb

        write_feb(pressed.scene, x, depth, pressures, feb)
        inform(f"FEBio: {feb}")
    if vtu is not None:
        from sim_backend.fem.io.vtu import write_vtu

        for path in write_vtu(pressed.solved.body, pressed.solved.states, vtu):
            inform(f"VTU: {path}")
    if (left_pct := pressed.error_estimate_pct) > accuracy:
        what = "force" if left_pct == pressed.force_error_estimate_pct else "pulse"
        finest = model in (None, "auto", names(pressed_into)[-1])
        inform(
            f"note: the {what}'s error of {left_pct:.2g} % misses the accuracy of {accuracy:g} % "
            "that was asked for: " + ("no finer mesh was tried" if finest else "leave --model out")
        )
    found: dict[str, Any] = plain(pressed.as_json())
    if json:
        answer_json(found)
        return
    for line in describe_press(found):
        answer(line)


def check_out(option: str, path: Path, mark: bytes) -> None:
    """Raises `SceneError` where a folder is at ``path`` or none above it, or a file whose first
    kilobyte has not the ``mark`` of those that a press writes."""
    from sim_backend.scene.scene_file import SceneError

    if path.is_file():
        with path.open("rb") as file:
            ours = mark in file.read(1024)
    else:
        ours = not path.is_dir()  # none yet, or a pipe
    if not path.parent.is_dir():
        raise SceneError(f"{option} {path}: there is no folder {path.parent}; make it first")
    if not ours:
        raise SceneError(
            f"{option} {path}: exists already and is no press's; choose another, or move it"
        )


def describe_press(found: dict[str, Any]) -> list[str]:
    """A press in lines, from its JSON: what was solved and why, each state, the pulse."""
    model = found["model"]
    strain = " strain" if model in ("finite", "small") else ""
    lines = [
        f"{found['scene']}, x = {found['x_mm']:g} mm, {found['depth_mm']:g} mm deep",
        f"  {model}{strain}, {found['element']} elements, {found['dofs']} degrees of freedom, "
        f"{found['seconds']:.2f} s, error of the force about "
        f"{found['force_error_estimate_pct']:.2g} %",
        f"  why: {found['why']}",
    ]
    for state in found["states"]:
        per_mm = state["force_n_per_mm"]
        force = f"{state['force_n']:.4g} N" + (
            f" ({per_mm:.4g} N per mm of finger)" if per_mm is not None else ""
        )
        left, right = state["contact_mm"]
        lines.append(
            f"  {state['pressure_mmhg']:g} mmHg: {force}, contact stress "
            f"{state['contact_stress_pa']:.0f} Pa, von Mises {state['von_mises_pa']:.0f} Pa, "
            f"touching {left:.2f} to {right:.2f} mm, ± {state['contact_error_mm']:.2g}"
        )
    if found["pulse_n"] is not None:
        lowest, *_, highest = sorted(found["states"], key=lambda state: state["pressure_mmhg"])
        falls = lowest["force_n"] > highest["force_n"]  # so it can beside a vessel
        lines.append(
            f"  pulse, trough to crest: {found['pulse_n']:.3g} N, {found['pulse_pa']:.1f} Pa of "
            f"contact stress, error about {found['pulse_error_estimate_pct']:.2g} %"
            + (": the force falls while the pressure rises" if falls else "")
        )
    return [*lines, *describe_taxels(found), *describe_gradient(found)]


def taxel_array(text: str | None, pitch_mm: float | None) -> Any:
    """The array that ``--taxels`` and ``--pitch`` mean, or None. Raises `SceneError`."""
    from sim_backend.scene.scene_file import SceneError
    from sim_backend.scene.taxels import TaxelArray

    if text is None:
        if pitch_mm is not None:
            raise SceneError(f"--pitch {pitch_mm:g}: of which taxels? Say --taxels 1x8, too")
        return None
    return TaxelArray(*rows_columns(text, "--taxels"), pitch_mm)


def describe_taxels(found: dict[str, Any]) -> list[str]:
    """The force on each taxel, row by row, and what no taxel takes."""
    lines = []
    for state in found["states"]:
        rows = state.get("taxels_n") or []
        if rows:
            beside = state["force_n"] - sum(map(sum, rows))
            rest = (
                f", {1e3 * beside:.3g} mN beside them" if beside > 1e-4 * state["force_n"] else ""
            )
            lines.append(f"  taxels at {state['pressure_mmhg']:g} mmHg [mN]{rest}:")
        lines += ["   " + "".join(f"{1e3 * one:9.2f}" for one in row) for row in rows]
    return lines


def describe_gradient(found: dict[str, Any]) -> list[str]:
    """What each state's force, and the pulse, change by; none where that was not asked."""
    states = [state for state in found["states"] if state.get("gradient")]
    if not states:
        return []
    heads = [f"{state['pressure_mmhg']:g} mmHg" for state in states]
    rows = {key: [state["gradient"][key] for state in states] for key in states[0]["gradient"]}
    if found.get("pulse_gradient"):
        heads.append("pulse")
        rows = {key: [*row, found["pulse_gradient"][key]] for key, row in rows.items()}
    wide = max(map(len, rows))
    lines = ["  mN more for one more of" + " " * (wide - 20) + "".join(f"{h:>12}" for h in heads)]
    for key, row in rows.items():
        lines.append(f"    {key:{wide}}" + "".join(f"{1e3 * value:12.4g}" for value in row))
    return lines
