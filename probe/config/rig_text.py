"""Keys written into a rig file, with everything else in it left as it is."""

import re
from collections.abc import Mapping
from typing import Any

import tomli_w

from drivers.core.files import parse_toml
from probe.config.rig import RigError

HEADER = re.compile(r"^\s*\[")
COMMENT = re.compile(r"^[^#\"']*?(\s+#.*)$")


def as_keys(keys: Mapping[str, Any]) -> str:
    """Each as one line of TOML."""
    return "\n".join(_line(key, value) for key, value in keys.items())


def with_keys(text: str, table: str, keys: Mapping[str, Any]) -> str:
    """A rig file's text in which ``keys`` stand in ``[table]``, replaced where they stood.

    Raises `RigError` where that cannot be done by lines alone.
    """
    lines = text.splitlines()
    start = next((n for n, line in enumerate(lines) if line.split("#")[0].strip() == f"[{table}]"),
                 None)  # fmt: skip
    if start is None:
        raise RigError(f"there is no [{table}] to write to; add the keys by hand")
    end = next((n for n in range(start + 1, len(lines)) if HEADER.match(lines[n])), len(lines))
    inside, left = lines[start + 1 : end], dict(keys)
    for number, line in enumerate(inside):
        key = line.split("=")[0].strip()
        if key in left:
            comment = COMMENT.search(line)
            inside[number] = _line(key, left.pop(key)) + (comment.group(1) if comment else "")
    last = max((n + 1 for n, line in enumerate(inside) if line.strip()), default=0)
    inside[last:last] = [_line(key, value) for key, value in left.items()]
    made = "\n".join([*lines[: start + 1], *inside, *lines[end:]]) + "\n"
    wanted = parse_toml(text.encode())
    wanted[table] |= {key: _plain(value) for key, value in keys.items()}
    try:
        found = parse_toml(made.encode())
    except ValueError:
        found = {}
    if found != wanted:
        raise RigError(f"[{table}] is not written one key a line; change the keys by hand")
    return made


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _line(key: str, value: Any) -> str:
    if isinstance(value, tuple):
        return f"{key} = [{', '.join(str(one) for one in value)}]"
    return tomli_w.dumps({key: value}).strip()
