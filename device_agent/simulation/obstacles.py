"""Things that stand, hang or walk in the way: for experiments with obstacles (the paper's Experiment 2)."""

from __future__ import annotations

from device_agent.simulation.building import Mover
from device_agent.simulation.people import STRIDE_M, Clothes, walking_figure
from device_agent.simulation.shapes import Piece, box

_CARDBOARD = "veneer/#b58a5a:carton"


def carton(x_m: float, y_m: float, yaw_deg: float = 0.0, size_m: tuple[float, float, float] = (0.5, 0.5, 0.9)) -> Piece:
    """A stack of cardboard boxes."""
    return box(size_m, _CARDBOARD, front="poster/carton", name="carton").moved(x_m, y_m, yaw_deg)


def low_box(x_m: float, y_m: float, yaw_deg: float = 0.0) -> Piece:
    """A box 25 cm high: under the view of a level camera."""
    return box((0.5, 0.4, 0.25), "fabric/#8a3f35", name="low box").moved(x_m, y_m, yaw_deg)


def velvet_box(x_m: float, y_m: float, yaw_deg: float = 0.0) -> Piece:
    """A bag that gives no depth at all: the depth camera shows a hole where it stands."""
    return box((0.5, 0.4, 0.35), "velvet/#0c0c0e", name="velvet box").moved(x_m, y_m, yaw_deg)


def hanging_box(x_m: float, y_m: float, yaw_deg: float = 0.0, low_m: float = 1.4) -> Piece:
    """A wall cupboard that hangs in the way at the height of the head: no cane finds it."""
    return box((0.7, 0.35, 0.6), "veneer/#7a5a3a:cupboard", base_m=low_m, name="hanging box").moved(x_m, y_m, yaw_deg)


def walking_person(
    path_m: tuple[tuple[float, float], ...],
    speed_mps: float = 0.9,
    start_s: float = 0.0,
    colour: str = "#b03a48",
    pause_s: float = 0.0,
) -> Mover:
    """Somebody who walks along a path and back, and stands for a while at its ends."""
    return Mover(walking_figure(Clothes(colour)), path_m, speed_mps, start_s, STRIDE_M, pause_s)
