"""The emulated controllers against the makers' own client libraries (`make test-peers`)."""

import pytest
from waiting import until

from drivers import WallClock
from sim_backend import load_scene
from sim_backend.emulators import pi, tmcl, zaber
from sim_backend.phantom.phantom import Phantom, Respond

WITHIN_S = 10.0
HOME = (0.032, 0.0, 0.002)
TCP = "socket://127.0.0.1:0"


@pytest.fixture
def phantom(winkler: Respond) -> Phantom:
    return Phantom(load_scene("TIHA"), WallClock(), winkler, home=HOME)


def rests_at(phantom: Phantom, x_m: float) -> None:
    until(lambda: not phantom.tip.moving(phantom.clock.now()), WITHIN_S)
    assert phantom.tip.point(phantom.clock.now()) == pytest.approx((x_m, 0.0, 0.002), abs=1e-6)


def test_zaber_motion_moves_stops_and_homes_it(phantom: Phantom) -> None:
    motion = pytest.importorskip("zaber_motion")
    ascii_ = pytest.importorskip("zaber_motion.ascii")
    per_mm = zaber.MICROSTEPS_PER_MM
    with zaber.emulate(phantom, at=TCP, homed=True) as chain:
        port = int(chain.address.rpartition(":")[2])
        with ascii_.Connection.open_tcp("127.0.0.1", port) as line:
            x, z = line.get_device(1).get_axis(1), line.get_device(3).get_axis(1)
            assert x.get_position() == pytest.approx(52.0 * per_mm, abs=1)
            assert z.get_position() == pytest.approx(38.0 * per_mm, abs=1)
            x.settings.set("maxspeed", round(20.0 * per_mm * 1.6384))
            x.move_absolute(round(54.0 * per_mm))
            rests_at(phantom, 0.034)
            x.move_absolute(round(90.0 * per_mm), wait_until_idle=False)
            assert x.is_busy()
            x.stop()
            assert not x.is_busy()
            with pytest.raises(motion.CommandFailedException, match="BADDATA"):
                x.move_absolute(round(-5.0 * per_mm))
            assert not x.warnings.get_flags()
            z.home()
            assert phantom.tip.point(phantom.clock.now())[2] == pytest.approx(0.040, abs=1e-6)
            assert x.is_homed()
            chain.fail("restart")
            assert not x.is_homed()
            assert "WR" in x.warnings.get_flags()
            z.home()
            chain.fail("stall")
            with pytest.raises(motion.MovementFailedException):
                z.move_absolute(round(20.0 * per_mm))


def test_pipython_moves_stops_and_references_it(phantom: Phantom) -> None:
    pipython = pytest.importorskip("pipython")
    commands = pytest.importorskip("pipython.pidevice.gcs2.gcs2commands")
    messages = pytest.importorskip("pipython.pidevice.gcsmessages")
    socket = pytest.importorskip("pipython.pidevice.interfaces.pisocket")
    with pi.emulate(phantom, at=TCP) as controller:
        port = int(controller.address.rpartition(":")[2])
        with socket.PISocket("127.0.0.1", port) as line:
            device = commands.GCS2Commands(messages.GCSMessages(line))
            assert "C-884" in device.qIDN()
            assert list(device.axes) == ["1", "2", "3"]
            assert device.qPOS("1")["1"] == pytest.approx(52.0, abs=1e-4)
            assert device.qTMX(["1", "2"]) == {"1": 100.0, "2": 40.0}
            with pytest.raises(pipython.GCSError) as error:
                device.MOV("1", 54.0)
            assert error.value.val == 5  # not referenced, or servo off
            device.SVO(["1", "2", "3"], [1, 1, 1])
            device.FRF("3")
            until(lambda: device.qFRF("3")["3"], WITHIN_S)
            assert device.qPOS("3")["3"] == pytest.approx(0.0, abs=1e-4)
            device.FRF(["1", "2"])
            until(lambda: all(device.qFRF().values()), WITHIN_S)
            device.VEL("1", 50.0)
            device.MOV({"1": 54.0})
            assert device.IsMoving("1")["1"]
            until(lambda: device.qONT("1")["1"], WITHIN_S)
            assert device.qPOS("1")["1"] == pytest.approx(54.0, abs=1e-4)
            device.MOV("1", 90.0)
            device.HLT("1", noraise=True)
            until(lambda: not device.IsMoving("1")["1"], WITHIN_S)
            assert 54.0 < device.qPOS("1")["1"] < 89.0
            with pytest.raises(pipython.GCSError) as error:
                device.MOV("1", 500.0)
            assert error.value.val == 7  # out of limits


def test_pytrinamic_moves_stops_and_searches_it(phantom: Phantom) -> None:
    pytest.importorskip("pytrinamic")
    from pytrinamic.connections import SerialTmclInterface
    from pytrinamic.modules import TMCM6110

    per_mm = tmcl.MICROSTEPS_PER_MM
    with tmcl.emulate(phantom, homed=True) as module:
        line = SerialTmclInterface(module.address, 9600)
        try:
            motors = TMCM6110(line, module_id=1).motors
            x, z = motors[0], motors[2]
            assert x.get_axis_parameter(x.AP.ActualPosition, signed=True) == pytest.approx(
                52.0 * per_mm, abs=1
            )
            x.move_to(round(54.0 * per_mm), round(20.0 * per_mm))
            assert not x.get_position_reached()
            until(x.get_position_reached, WITHIN_S)
            rests_at(phantom, 0.034)
            x.move_to(round(90.0 * per_mm))
            assert x.get_axis_parameter(x.AP.ActualVelocity, signed=True) > 0
            x.stop()
            until(lambda: x.get_axis_parameter(x.AP.ActualVelocity, signed=True) == 0, WITHIN_S)
            assert not x.get_position_reached()
            line.reference_search(0, 2, module_id=1)
            until(lambda: line.reference_search(2, 2, module_id=1) == 0, WITHIN_S)
            assert z.get_axis_parameter(z.AP.ActualPosition, signed=True) == 0
            line.set_global_parameter(55, 2, -7, module_id=1)
            assert line.get_global_parameter(55, 2, module_id=1, signed=True) == -7
        finally:
            line.close()


def test_panda_python_has_what_the_example_uses() -> None:
    panda = pytest.importorskip("panda_py")
    controllers = pytest.importorskip("panda_py.controllers")
    used = ("get_position", "get_orientation", "start_controller", "stop_controller")
    assert all(hasattr(panda.Panda, name) for name in used)
    assert hasattr(controllers.CartesianImpedance, "set_control")
    with pytest.raises(RuntimeError):
        panda.Panda("127.0.0.1")
