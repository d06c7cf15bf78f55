"""Reference pages that are made from the code when the site is built: commands, rig file, API."""

import html
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import mkdocs_gen_files
import typer.main

import palpate
from probe.cli.command_line import build
from probe.config.json_schema import rig_schema

GENERATED = "<!-- Made from the code by docs/generate.py. -->\n\n"


def commands() -> str:
    """Every command with its arguments and options."""
    group: Any = typer.main.get_command(build())
    context = group.make_context("palpate", ["--help"], resilient_parsing=True)
    pages = [GENERATED + "# Commands\n\n`palpate COMMAND --help` shows the same.\n"]
    return "\n".join([*pages, *_commands_of(group, context, "##")])


def _commands_of(group: Any, context: Any, head: str) -> Iterator[str]:
    for name in sorted(group.commands):
        command = group.commands[name]
        if command.hidden:
            continue
        own = command.make_context(name, [], parent=context, resilient_parsing=True)
        usage = command.get_usage(own).removeprefix("Usage: ")
        title = own.command_path.removeprefix("palpate ")
        yield f"{head} {title}\n\n{inspect.cleandoc(command.help or '')}\n"
        yield f"```text\n{usage}\n```\n"
        if hasattr(command, "commands"):
            yield from _commands_of(command, own, head + "#")
            continue
        rows = (_parameter(one, own) for one in command.get_params(own))
        yield "| argument or option | what it is |\n|---|---|\n" + "\n".join(rows) + "\n"


def _parameter(one: Any, context: Any) -> str:
    record = one.get_help_record(context)
    if record is None:
        shown = getattr(one, "help", "") or ""
        return f"| {_code(one.make_metavar(context))} | {_cell(shown)} |"
    return f"| {_code(record[0])} | {_cell(record[1])} |"


def rig_file() -> str:
    """The tables and keys of a rig file, from the schema that editors check it by."""
    schema = rig_schema()
    named = schema["$defs"]
    parts = [
        GENERATED + "# The rig file\n\nWhich devices, what to press where, and what must never be "
        "exceeded. Every number carries its unit in its name. A wrong key or value is refused by "
        "name before anything moves. `palpate schema rig` prints the same as a JSON schema. A grid "
        "has pairs where a row has numbers:\n\n"
        "```toml\n[scan]\nstart_mm = [16.0, -4.0]\npitch_mm = [4.0, 2.0]\nstations = [9, 5]\n"
        "touch_n = 0.05    # find the surface by touch\nsearch_mm = 1.5\n```\n\n"
        "Any key can be given for one scan: `palpate scan RIG.toml --set scan.pitch_mm=2`.\n"
    ]
    tables = {
        "top of the file": schema,
        "`[scan]`": named["Scan"],
        "`[safety]`": named["Safety"],
        "`[safety.workspace_mm]`": named["Workspace"],
        "`[scene]`": named["SceneChoice"],
    }
    for title, table in tables.items():
        parts += _keys(title, table, schema)
    for kind, head in (("stage", "`[stage]`"), ("sensor", "`[[sensor]]`")):
        for name, table in named.items():
            driver = name.removeprefix(f"{kind}_")
            if name.startswith(f"{kind}_") and driver != "device":
                parts += _keys(f'{head} with `driver = "{driver}"`', table, schema)
    inner = ("PiAxis", "TmclAxis", "ZaberAxis", "TextChannel", "Register")
    heads = {
        "PiAxis": "axes of `pi`",
        "TmclAxis": "axes of `tmcl`",
        "ZaberAxis": "axes of `zaber`",
        "TextChannel": "`[[sensor.channel]]` of `lines` and `lsl`",
        "Register": "`[[sensor.register]]` of `modbus`",
    }
    for name in inner:
        parts += _keys(heads[name], named[name], schema)
    return "\n".join(parts)


def _keys(title: str, table: dict[str, Any], schema: dict[str, Any]) -> Iterator[str]:
    """A heading, and a row for each key of a table."""
    about = " ".join(str(table.get("description", "")).split("\n\n")[0].split())
    yield f"## {title}\n\n{about}\n"
    yield "| key | what may stand there | default | what it is |\n|---|---|---|---|"
    needed = table.get("required", ())
    for key, value in table["properties"].items():
        default = "required" if key in needed else _default(value)
        yield (
            f"| `{key}` | {_cell(_allowed(value, schema))} | {default} | "
            f"{_cell(value.get('description', ''))} |"
        )
    yield ""


def _allowed(value: dict[str, Any], schema: dict[str, Any]) -> str:
    if "$ref" in value:
        target = schema["$defs"][value["$ref"].removeprefix("#/$defs/")]
        return _allowed(target, schema) if "enum" in target else "a table"
    if "anyOf" in value:
        return " or ".join(
            _allowed(choice, schema) for choice in value["anyOf"] if choice.get("type") != "null"
        )
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{choice}`" for choice in value["enum"])
    if value.get("type") == "array":
        if "prefixItems" in value:
            inner = (_allowed(item, schema) for item in value["prefixItems"])
            return "[" + ", ".join(inner) + "]"
        return "a list of " + _allowed(value["items"], schema).replace("a table", "tables")
    words = {
        "number": "number", "integer": "whole number", "string": "text", "object": "a table",
        "boolean": "`true` or `false`",
    }  # fmt: skip
    limits = [
        f"{sign} {value[key]:g}"
        for key, sign in (
            ("exclusiveMinimum", "above"),
            ("minimum", "from"),
            ("exclusiveMaximum", "below"),
            ("maximum", "to"),
        )
        if key in value
    ]
    return " ".join([words.get(value.get("type", ""), "anything"), *limits])


def _default(value: dict[str, Any]) -> str:
    """As TOML would have it."""
    default = value.get("default")
    if default is None or isinstance(default, dict):
        return "–"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return f"`{default}`" if default != "" else '`""`'


def api() -> str:
    """The public names by their home, as mkdocstrings directives."""
    parts = [
        GENERATED + "# Python\n\n`import palpate` gives these names, each imported when it is "
        "first used. What a driver's author needs is in `drivers`: "
        "[Write a driver](../how-to/add-a-driver.md).\n"
    ]
    for name, home in _functions_first():
        parts.append(f"::: {home}.{name}\n")
    return "\n".join(parts)


def _functions_first() -> Iterator[tuple[str, str]]:
    found = []
    for name in palpate.__all__:
        one = getattr(palpate, name)
        home = getattr(one, "__module__", None)
        if not inspect.isclass(one) and not inspect.isfunction(one):
            continue
        assert home is not None
        assert hasattr(import_module(home), name)
        found.append((inspect.isclass(one), name, home))
    for _, name, home in sorted(found):
        yield name, home


def decisions() -> str:
    """The list of all decisions, by their first lines."""
    pages = sorted(Path(__file__).parent.glob("decisions/0*.md"))
    titles = [page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ") for page in pages]
    listed = "\n".join(f"- [{t}]({p.name})" for t, p in zip(titles, pages, strict=True))
    return (
        "# Decisions\n\nWhy things are as they are. Each page has a date, a status and the "
        f"alternatives.\n\n{listed}\n"
    )


def _code(text: str) -> str:
    """As code in a table, where a bar within backticks would keep its backslash."""
    return f"<code>{html.escape(text).replace('|', '&#124;')}</code>"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


for path, text in (
    ("reference/cli.md", commands()),
    ("reference/rig-file.md", rig_file()),
    ("reference/api.md", api()),
    ("decisions/index.md", decisions()),
):
    with mkdocs_gen_files.open(path, "w") as page:
        page.write(text)
