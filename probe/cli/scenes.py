"""The phantom without a scan: its scenes, and a window to feel it by hand."""

from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import typer

from probe.cli.arguments import scene_names
from probe.cli.say import Json, answer, answer_json
from probe.cli.windows import need_windows


def scenes(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Print this scene's file, to start your own from.", autocompletion=scene_names
        ),
    ] = None,
    json: Json = False,
) -> None:
    """List the built-in scenes, or print one as a scene file."""
    from sim_backend.scene.scene_file import load_scene
    from sim_backend.scene.scene_file import scene_names as built_in_names

    if name is not None:
        scene = load_scene(name)
        if json:
            answer_json(scene.model_dump(mode="json"))
        else:
            built_in = resources.files("sim_backend.scene") / "builtin" / f"{name}.toml"
            file = built_in if name in built_in_names() else Path(name)
            answer(file.read_text(encoding="utf-8").rstrip())
        return
    found = {one: describe(load_scene(one)) for one in built_in_names()}
    if json:
        answer_json({"scenes": found})
        return
    for one, text in found.items():
        answer(f"{one:10} {text}")


def feel(
    scene: Annotated[str, typer.Option(help="A built-in scene or a scene file.")] = "TIHA",
) -> None:
    """Press the phantom by hand in a window: mouse or arrow keys."""
    need_windows()
    from probe.gui.feel import run_feel
    from sim_backend.scene.scene_file import load_scene

    raise typer.Exit(run_feel(load_scene(scene)))


def describe(scene: Any) -> str:
    """One line on what lies in a scene."""
    parts = []
    for one in scene.inclusion:
        kind = one.kind
        if kind == "artery" and one.stenosis is not None:
            kind = f"artery with a {100 * one.stenosis.fraction:.0f} % stenosis"
        where = f" at {one.x_mm:g} mm, {one.depth_mm:g} mm deep" if scene.tissue else ""
        parts.append(f"{kind}, {2 * one.outer_radius_mm:g} mm across{where}")
    inside = "; ".join(parts) or "nothing"
    if scene.tissue is None:
        return f"on a support: {inside}"
    return f"in {scene.tissue.width_mm:g} x {scene.tissue.height_mm:g} mm of tissue: {inside}"
