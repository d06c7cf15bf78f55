"""The runner: picks up where it stopped, one line of JSON a mutant; prints the survivors.

python -m mutants --log mutants.jsonl            every mutant that the log does not hold
python -m mutants --only NAME                    one, with what its witnesses say
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

from mutants.catalogue import MUTANTS
from mutants.mutant import Gone, Mutant

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("probe", "drivers", "sim_backend", "calibration", "palpate", "tests", "benchmarks",
          "rigs", "pyproject.toml", "README.md")  # fmt: skip
COMPILED = (".c", ".h")
TIMEOUT_S = 180.0
OURS = ("palpate", "probe", "drivers", "sim_backend", "calibration", "campaign", "mutants")
THEIRS = (
    "numpy", "scipy.signal", "scipy.interpolate", "scipy.optimize", "scipy.spatial.transform",
    "scipy.sparse.linalg", "scipy.stats", "pydantic", "typer", "rich.progress", "matplotlib",
    "serial", "pymodbus.client", "re2", "pandas", "pytest",
)  # fmt: skip
NAMES = {mutant.name for mutant in MUTANTS}


def copy_tree(into: Path) -> None:
    """The packages with their compiled files, so that only what is broken is compiled anew."""
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, into / name)
        else:
            shutil.copy2(source, into / name)


def compile_kernel(tree: Path) -> None:
    """The kernel of ``tree``, anew. Raises `subprocess.CalledProcessError`."""
    build = [sys.executable, "-c", "import setuptools; setuptools.setup()", "build_ext"]
    subprocess.run([*build, "--inplace", "--force"], cwd=tree, check=True, capture_output=True)


def ask(tree: Path, tests: tuple[str, ...], runs: tuple[str, ...]) -> list[str]:
    """Who of the witnesses fails in this tree; the first is enough."""
    if tests:
        code, said = in_tree(tree, partial(_test, tests))
        if code not in (0, 1):
            raise RuntimeError(f"pytest could not run {tests}: exit {code}\n{said[-2000:]}")
        if code == 1:
            ends = ("FAILED tests/", "ERROR tests/")  # a log that a test prints has errors too
            failed = [line for line in said.splitlines() if line.startswith(ends)]
            if failed and not any(test in failed[0] for test in tests):
                raise RuntimeError(f"asked for {tests}, and another failed: {failed[0]}")
            return [failed[0][:160] if failed else f"a test: {said[-80:]}"]
    for run in runs:
        code, _ = in_tree(tree, partial(_campaign, run))
        if code:
            return [f"campaign: {run}"]
    return []


def _test(tests: tuple[str, ...]) -> int:
    import pytest

    return int(pytest.main(["-x", "-q", "-p", "no:xdist", "-p", "no:cacheprovider", *tests]))


def _campaign(run: str) -> int:
    clock, seed, kinds = run.split(" ", 2)
    sys.argv = ["campaign", "one", *kinds.split("+"), "--seed", seed, "--clock", clock]
    main = import_module("campaign.__main__").main
    return int(main())


def in_tree(tree: Path, work: Callable[[], int]) -> tuple[int, str]:
    """Do it in a fork that imports palpate from ``tree``; its status and what it printed.

    Everything that is not palpate is imported already, which is most of the time a test takes.
    """
    with TemporaryFile() as said:
        pid = os.fork()
        if pid == 0:
            code = 70
            try:
                _enter(tree, said.fileno())
                code = work()
            except SystemExit as ended:
                code = int(ended.code or 0) if not isinstance(ended.code, str) else 70
            except BaseException:  # noqa: BLE001 - a fork must never go on as its parent
                traceback.print_exc()
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
        code = _wait(pid)
        said.seek(0)
        return code, said.read().decode("utf-8", "replace")


def _enter(tree: Path, out: int) -> None:
    os.setsid()
    for number in (1, 2):
        os.dup2(out, number)
    os.chdir(tree)
    folders = [str(tree), str(tree / "benchmarks"), str(tree / "tests" / "support")]
    ours = str(ROOT)
    sys.path[:] = folders + [path for path in sys.path if path and not path.startswith(ours + "/b")]
    os.environ["PYTHONPATH"] = os.pathsep.join(folders)
    for name in [name for name in sys.modules if name.split(".")[0] in OURS]:
        del sys.modules[name]


def _wait(pid: int) -> int:
    """The exit status; a witness that hangs is ended with all it started, and has noticed."""
    until_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < until_s:
        found, status = os.waitpid(pid, os.WNOHANG)
        if found:
            return abs(os.waitstatus_to_exitcode(status))
        time.sleep(0.02)
    os.killpg(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return 1


def check_copy(tree: Path) -> None:
    """The copy, not the installed tree, must be what is imported."""
    code, said = in_tree(tree, lambda: print(import_module("probe").__file__) or 0)
    if code or str(tree) not in said:
        raise RuntimeError(f"the copy in {tree} is not imported: {said}")


def kill(mutant: Mutant, tree: Path) -> dict[str, Any]:
    """Break the tree, ask the witnesses, mend it; a row."""
    row: dict[str, Any] = {"mutant": mutant.name, "file": mutant.file}
    file = tree / mutant.file
    sound = file.read_bytes()
    stat = file.stat()
    try:
        broken = mutant.mutated(tree)
    except Gone as gone:
        return {**row, "noticed": [], "gone": str(gone)}
    try:
        file.write_text(broken, encoding="utf-8")
        if file.suffix in COMPILED:
            compile_kernel(tree)
        row["noticed"] = ask(tree, mutant.tests, mutant.runs)
    finally:
        file.write_bytes(sound)
        os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))
        if file.suffix in COMPILED:
            compile_kernel(tree)
    return {**row, "at": datetime.now(UTC).isoformat(timespec="seconds")}


def main() -> int:
    """Run; 0 if every mutant was noticed."""
    parser = argparse.ArgumentParser(prog="mutants", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--log", type=Path, default=Path("mutants.jsonl"))
    parser.add_argument("--only", help="the mutants of which the name holds this")
    parser.add_argument("--part", default="0/1", help="such as 1/3: the second of three parts")
    parser.add_argument("--sound", action="store_true", help="ask all witnesses of the sound tree")
    given = parser.parse_args()
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "QT_QPA_PLATFORM": "offscreen"}
    for name in THEIRS:
        with suppress(ImportError):
            import_module(name)
    with TemporaryDirectory(prefix="palpate-mutants-") as folder:
        tree = Path(folder)
        copy_tree(tree)
        check_copy(tree)
        if given.sound:
            tests = tuple(sorted({test for mutant in MUTANTS for test in mutant.tests}))
            runs = tuple(sorted({run for mutant in MUTANTS for run in mutant.runs}))
            failed = ask(tree, tests, ()) + [w for run in runs for w in ask(tree, (), (run,))]
            print("the sound tree fails:" if failed else "the sound tree passes", *failed)
            return len(failed)
        if given.only:
            rows = [kill(m, tree) for m in MUTANTS if given.only in m.name]
            print(json.dumps(rows, indent=2))
            return sum(not row["noticed"] for row in rows)
        part, parts = map(int, given.part.split("/"))
        return _run_all(tree, given.log, MUTANTS[part::parts])


def _run_all(tree: Path, log: Path, mutants: tuple[Mutant, ...]) -> int:
    before = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    rows = {row["mutant"]: row for row in map(json.loads, before)}
    with log.open("a", encoding="utf-8") as out:
        for mutant in mutants:
            if mutant.name in rows:
                continue
            rows[mutant.name] = row = kill(mutant, tree)
            out.write(json.dumps(row) + "\n")
            out.flush()
            said = "noticed " if row["noticed"] else "SURVIVES"
            print(said, mutant.name, *row["noticed"][:1], flush=True)  # else a fork says it again
    known = [row for name, row in rows.items() if name in NAMES]
    survivors = [row["mutant"] for row in known if not row["noticed"]]
    print(f"{len(known) - len(survivors)} of {len(known)} noticed; survivors: {survivors}")
    return len(survivors)


if __name__ == "__main__":
    sys.exit(main())
