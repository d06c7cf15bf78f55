"""The tables by which depth and size of what lies beneath are known: those there are, and more."""

import os
from pathlib import Path
from typing import Annotated

import typer

from probe.cli.arguments import SCENE, Workers
from probe.cli.say import Json, answer, answer_json


def touch(
    scene: Annotated[str | None, SCENE] = None,
    make: Annotated[
        bool, typer.Option("--make", help="Solve its presses and keep the table here.")
    ] = False,
    presses: Annotated[
        int,
        typer.Option(metavar="N", min=20, help="Presses over lumps, and as many over vessels."),
    ] = 3000,
    workers: Workers = None,
    json: Json = False,
) -> None:
    """List the touch tables: by one of the finger that scanned, detect knows depth and size.

    With a scene: whether a table knows its finger, support and block, and --make makes one.
    """
    from sim_backend.scene.scene_file import SceneError, load_scene
    from sim_backend.touch.kept import kept_as, table_for, tables

    if scene is None:
        if make:
            raise typer.BadParameter("--make needs a scene: that of the finger and the support")
        listed = {str(file): table.said() for file, table in tables()}
        if json:
            answer_json({"tables": listed})
        for file, said in {} if json else listed.items():
            answer(f"{said['words']}\n    {file}")
        return
    block = load_scene(scene)
    block.need_section("touch tables know")
    if block.tissue is None:
        raise SceneError(f"{scene}: tables are of blocks of tissue in plane stress or strain")
    kept: Path | None = None
    table = table_for(block)
    if table is None and make:
        from drivers.core.processes import Workers
        from probe.cli.progress import counting
        from sim_backend.models.train_touch import touch_table

        with Workers(workers or os.cpu_count() or 1) as pool, counting("presses") as bar:
            table = touch_table(block, presses, pool.map, bar)
        kept = kept_as(table)
    known = table is not None and table.knows(block)
    if json:
        about = table.said() if table else None
        answer_json({"scene": scene, "known": known, "table": about, "kept": kept})
    elif table is None:
        answer(f"{scene}: no touch table of this finger on this support; --make makes one")
    else:
        words = table.said()["words"]
        answer(f"{scene}: {words}" + ("" if known else "; its blocks are other ones than this"))
