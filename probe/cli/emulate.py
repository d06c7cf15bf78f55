"""``palpate emulate``: controllers that speak their real protocols and answer from the phantom."""

import errno
import signal
import sys
import threading
from collections.abc import Mapping
from contextlib import ExitStack, closing, suppress
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any

import typer

from probe.cli.arguments import emulated_devices
from probe.cli.say import answer, inform

if TYPE_CHECKING:  # commands import what they need when they run
    from sim_backend.emulators.serving import Served
    from sim_backend.phantom.phantom import Response
    from sim_backend.scene.scene_file import Scene
    from sim_backend.scene.taxels import TaxelArray


def emulate(
    devices: Annotated[
        list[str],
        typer.Argument(
            metavar="DEVICE...",
            help="Such as ur, grbl, ft300, modbus.",
            autocompletion=emulated_devices,
        ),
    ],
    scene: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="The phantom that all of them share.")
    ] = "TIHA",
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="DEVICE=ADDRESS", help="Where to serve: a path for a pty, socket://HOST:PORT."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the phantom's noise.")] = 0,
) -> None:
    """Serve emulated devices, all in one phantom, until Ctrl-C.

    Each address goes into a rig file. Type `DEVICE FAULT` to make one fail, `DEVICE ok` to end
    the fault.
    """
    from sim_backend.emulators import DEVICES, STAGES

    for name in devices:
        if name not in DEVICES:
            raise typer.BadParameter(f"device {name!r}: allowed are {', '.join(DEVICES)}")
    places = _addresses(at or [], devices)
    from drivers import ConfigError, WallClock
    from probe.guards.guard_threads import come_first
    from sim_backend.emulators.solving import Solver
    from sim_backend.phantom.phantom import Phantom
    from sim_backend.scene.scene_file import load_scene

    phantom = Phantom(load_scene(scene), WallClock(), solve_here, seed=seed)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: take the links away
    with ExitStack() as open_devices:
        solver = open_devices.enter_context(closing(Solver(phantom)))
        come_first()  # a controller keeps its time whatever else runs, guards included
        served: dict[str, Served] = {}
        for name in devices:
            module = import_module(f"sim_backend.emulators.{name}")
            chosen: dict[str, Any] = {"at": places[name]} if name in places else {}
            if name in STAGES:  # they hold a press until its place is solved
                chosen["ready"] = solver.ready
            try:
                served[name] = open_devices.enter_context(module.emulate(phantom, **chosen))
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                raise ConfigError(
                    f"{name}: its address is taken, perhaps by an emulator that still runs; end "
                    f"that one, or say --at {name}=ADDRESS"
                ) from None
            answer(f"{name}: {served[name].address}  faults: {', '.join(served[name].faults)}")
        with suppress(KeyboardInterrupt):
            obey(served)
            threading.Event().wait()  # standard input has ended; serve on


def solve_here(
    scene: "Scene", x_m: float, max_depth_m: float, array: "TaxelArray | None" = None
) -> "Response":
    """A section that no stage has asked for, such as one that the tip is dragged through."""
    from sim_backend.models.station_response import respond

    return respond(scene, x_m, max_depth_m, array)


def obey(served: "Mapping[str, Served]") -> None:
    """Do what is typed until standard input ends: ``DEVICE FAULT`` or ``DEVICE ok``."""
    for line in sys.stdin:
        name, _, fault = line.strip().partition(" ")
        if not name:
            continue
        if name not in served:
            inform(f"{name!r}: serving {', '.join(served)}")
            continue
        try:
            served[name].fail(None if fault in ("", "ok") else fault)
        except ValueError as error:
            inform(str(error))
        else:
            inform(f"{name}: {fault or 'ok'}")


def _addresses(given: list[str], devices: list[str]) -> dict[str, str]:
    """The values of ``--at`` by device."""
    places = {}
    for text in given:
        name, equals, address = text.partition("=")
        if not equals and len(devices) == 1:
            name, address = devices[0], text
        elif name not in devices or not address:
            raise typer.BadParameter(f"--at {text}: DEVICE=ADDRESS with one of {devices} is needed")
        places[name] = address
    return places
