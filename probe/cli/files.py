"""``palpate init`` and ``palpate schema``: files to start from, and what editors check them by."""

import json
import shlex
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from probe.cli.say import answer, inform

NEXT = {
    "rig": "palpate scan {folder}/rig.toml --dry-run",
    "scene": "palpate scan --scene {folder}/scene.toml --dry-run",
    "driver": "pip install pytest -e {folder} && cd {folder} && "
    "pytest --palpate-driver=my_gauge --palpate-bench=my_bench:bench",
}


def init(
    kind: Annotated[Literal["rig", "scene", "driver"], typer.Argument(help="What to begin.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where; made if need be.")],
) -> None:
    """Write a commented rig, scene or driver to start from; nothing is overwritten."""
    from drivers.core.files import naming

    source = resources.files("probe.cli") / "templates"
    files: dict[str, str] = {}
    if kind == "driver":
        files = {one.name: _text(one) for one in (source / kind).iterdir() if one.is_file()}
    else:
        files[f"{kind}.toml"] = _text(source / f"{kind}.toml")
        files[f"{kind}.schema.json"] = schema_text(kind)
    there = [folder / name for name in files if (folder / name).exists()]
    if there:
        raise typer.BadParameter(f"{there[0]} exists; give another folder")
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in sorted(files.items()):
        try:
            with naming(folder / name):
                (folder / name).write_text(text, encoding="utf-8")
        except OSError:  # half a file would be in the way
            (folder / name).unlink(missing_ok=True)
            raise
        answer(str(folder / name))
    inform("Next: " + NEXT[kind].format(folder=shlex.quote(str(folder))))


def schema(
    kind: Annotated[Literal["rig", "scene"], typer.Argument(help="Of which file.")],
) -> None:
    """Print the JSON schema of rig or scene files, with the keys of every installed driver.

    Saved as rig.schema.json beside a rig file that begins with `#:schema rig.schema.json`, it lets
    editors complete and check the keys.
    """
    answer(schema_text(kind).rstrip())


def schema_text(kind: str) -> str:
    """The schema as it is kept in a file."""
    from probe.config.json_schema import rig_schema, scene_schema

    made: dict[str, Any] = rig_schema() if kind == "rig" else scene_schema()
    return json.dumps(made, indent=1, ensure_ascii=False) + "\n"


def _text(file: Traversable) -> str:
    return file.read_text(encoding="utf-8")
