"""Every figure, the quick ones first."""

from figures.calibrating import calibration, wrong_rig
from figures.fleet import fleet
from figures.installing import install
from figures.keep import Figure
from figures.presses import lone_vessel, paper
from figures.scans import demo

FIGURES = {
    figure.name: figure
    for figure in (
        Figure("demo", 0.5, demo),
        Figure("install", 1.5, install),
        Figure("lone-vessel", 0.5, lone_vessel),
        Figure("wrong-rig", 2, wrong_rig),
        Figure("calibration", 7, calibration),
        Figure("paper", 6, paper),
        Figure("fleet", 25, fleet),
    )
}
