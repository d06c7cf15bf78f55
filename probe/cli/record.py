"""``palpate record``: what a live device is sent and answers, as a file that a test can replay."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from probe.cli.arguments import storable
from probe.cli.say import answer, inform

if TYPE_CHECKING:  # commands import what they need when they run
    from drivers.core.registry import Kind
    from probe.config.rig import Device


def record(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="The rig with the devices.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the files go.")] = Path(),
    device: Annotated[
        str,
        typer.Option(
            metavar="TEXT", help="What the device is: maker, model, firmware.", callback=storable
        ),
    ] = "",
    seconds: Annotated[float, typer.Option(min=0.1, max=60, help="How long sensors are read.")] = 2,
    move_mm: Annotated[
        float,
        typer.Option(
            min=0, max=20, help="Move the stage up by this much [mm] and back; 0: do not move."
        ),
    ] = 0,
) -> None:
    """Record every device of a rig on a serial line or a TCP port, byte by byte.

    The files go into `tests/drivers/exchanges`: from then on the driver is tested against your
    device without it. A UR arm is not recorded: its library opens several ports by itself.
    """
    from drivers import ConfigError
    from drivers.testing.exchange import save
    from drivers.testing.record import record as listen
    from probe.config.load_rig import load_rig
    from probe.config.rig import RigError

    loaded = load_rig(rig)
    found: list[tuple[Kind, Device]] = [("stages", loaded.stage)]
    found += [("sensors", sensor) for sensor in loaded.sensor]
    wanted = [(kind, one) for kind, one in found if {"port", "host"} & set(one.settings)]
    if not wanted:
        raise RigError(f"{rig}: no device with a port or a host to record")
    out.mkdir(parents=True, exist_ok=True)
    recorded = 0
    for kind, one in wanted:
        inform(f"Recording {one.driver} …")
        try:
            exchange = listen(
                kind, one.driver, one.settings, seconds=seconds, move_mm=move_mm, device=device
            )
        except ConfigError as error:
            inform(str(error))
            continue
        recorded += 1
        path = out / f"{one.settings.get('name', one.driver)}.toml"
        save(exchange, path)
        answer(f"{path}: {len(exchange.pairs)} exchanges, {len(exchange.rows)} readings")
    if not recorded:
        raise RigError(f"{rig}: no device could be recorded")
