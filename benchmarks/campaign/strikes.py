"""What a fault does to the world, the board and the cell, at the instant at which it strikes."""

import math

from campaign.board import Board
from campaign.cell import Cell
from campaign.faults import Fault
from campaign.world import World


def strike(fault: Fault, world: World, board: Board, cell: Cell) -> None:
    """Let it happen; kinds that strike elsewhere do nothing here."""
    if fault.kind.where == "cell":
        cell.since_s = world.time_s
        _ail_cell(fault, cell)
    elif fault.kind.where == "board":
        _ail_board(fault, world, board)
    elif fault.kind.where == "bed":
        _move_bed(fault, world)


def _ail_cell(fault: Fault, cell: Cell) -> None:
    sores, (a, b, _) = cell.sores, fault.size
    match fault.kind.name:
        case "cell stuck":
            sores.stuck = True
        case "cell clipped":
            sores.clip_n = cell.world.force_n + cell.zero_n + 0.02 * a
        case "cell clipped with noise":
            sores.clip_n, sores.hums = cell.world.force_n + cell.zero_n + 0.02 * a, True
        case "cell drifting":
            sores.drift_n_s = -(0.02 + 0.5 * a)
        case "cell silent":
            sores.silent = True
        case "cell gone":
            cell.dead = True
        case "cell in bursts":
            sores.burst_s = 0.05 + 0.25 * a
        case "cell says nan":
            sores.word = "nan"
        case "cell prints nonsense":
            sores.word = "0" * 27 + "?"
        case "cell reversed":
            sores.gain = -1.0
        case "cell clock back":
            sores.jump_s = -(0.05 + 5 * a)
        case "cell clock ahead":
            sores.jump_s = 0.05 + 5 * a
        case "cell spikes":
            sores.extra_n = 3.0 + 20 * a
        case "cell loses lines":
            sores.keep = 0.2 + 0.7 * b


def _ail_board(fault: Fault, world: World, board: Board) -> None:
    ills, now, (a, b, _) = board.ills, world.time_s, fault.size
    match fault.kind.name:
        case "board deaf":
            ills.deaf = True
        case "board mute":
            ills.mute_until_s = math.inf
        case "board gone":
            board.dead = True
        case "board slow":
            ills.slow = 0.15 + 0.5 * a
        case "board stalled":
            world.stalled = True
        case "board runs on":
            ills.runs_on = True
        case "board loses stops":
            ills.lost_stops = 1 + int(12 * a)
        case "board stops late":
            ills.stop_delay_s = 0.15 * a
        case "board lies":
            ills.blind = world.place
        case "board answers late":
            ills.late_s = 0.02 + 0.08 * a
        case "board pauses":
            ills.mute_until_s = now + 0.05 + 0.9 * a
        case "board alarm":
            board.alarm(1 if b < 0.5 else 10)
        case "board restarts":
            board.restart()
        case "board garbles":
            ills.garbage = 1 + int(6 * a)


def _move_bed(fault: Fault, world: World) -> None:
    now, (a, b, _) = world.time_s, fault.size
    match fault.kind.name:
        case "cough":
            world.lift_m_s, world.lift_until_s = 0.03, now + 0.02 + 0.1 * a
        case "pulled sideways":
            way = 1 if b < 0.5 else -1
            world.slip_m_s, world.slip_until_s = (0.0, way * 10e-3, 0.0), now + 0.05 + 0.75 * a
        case "pushed deeper":
            world.slip_m_s, world.slip_until_s = (0.0, 0.0, -8e-3), now + 0.05 + 0.2 * a
