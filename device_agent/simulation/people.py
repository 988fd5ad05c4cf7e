"""Walking people: a body with swinging arms and legs, as a picture book of one stride.

The swing of hip and knee follows, roughly, D. Winter, "The biomechanics and motor control of human gait" (1991): the
hip swings by some ±25°, the knee bends by up to 60° while the leg swings forwards, and the arms go against the legs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from device_agent.simulation.shapes import Piece, Point3, Solid, Surface, box, column, together

POSES = 16
"""Pictures of one stride, which is two steps."""
STRIDE_M = 1.4
"""Length of a stride at an easy pace."""
BODY_RADIUS_M = 0.28
_HIP_M, _THIGH_M, _SHIN_M, _SHOULDER_M, _ARM_M = 0.90, 0.44, 0.42, 1.42, 0.62
_HIP_SWING_RAD, _KNEE_BEND_RAD, _ARM_SWING_RAD = math.radians(25.0), math.radians(50.0), math.radians(22.0)


@dataclass(frozen=True, slots=True)
class Clothes:
    """What somebody wears, by which people are told apart."""

    shirt: str = "#b03a48"
    trousers: str = "#2e3440"
    skin: str = "#d9a98a"
    hair: str = "#3a2a20"
    bag: str = ""
    """Label of the picture on their bag; empty for nobody's bag."""


WARDROBE = (
    Clothes("#b03a48", "#2e3440", bag="north"),
    Clothes("#3f6f8f", "#5b4a3a", "#8d5a3c", "#1d1612"),
    Clothes("#c9a13b", "#33475b", "#e3b99a", "#7a4a22", "south"),
    Clothes("#e4e0d6", "#4a5a48", "#c08a68", "#2a2a2c"),
    Clothes("#556b4a", "#1f2328", "#d9a98a", "#8a8580", "east"),
)


def walking_figure(clothes: Clothes = WARDROBE[0], poses: int = POSES) -> tuple[Piece, ...]:
    """Return a grown person at ``poses`` moments of one stride; facing +x, standing on z = 0."""
    return tuple(_figure(clothes, math.tau * k / poses) for k in range(poses))


def _figure(clothes: Clothes, phase_rad: float) -> Piece:
    swing = math.sin(phase_rad)
    # A leg swings forwards while its hip angle grows, and bends its knee to clear the floor.
    knees = [max(0.0, way * math.cos(phase_rad)) ** 2 * _KNEE_BEND_RAD for way in (1.0, -1.0)]
    legs = [
        _leg(clothes, way * _HIP_SWING_RAD * swing, knee).moved(0.0, way * 0.1)
        for way, knee in zip((1.0, -1.0), knees, strict=True)
    ]
    arms = [_arm(clothes, -way * _ARM_SWING_RAD * swing).moved(0.0, way * 0.27) for way in (1.0, -1.0)]
    standing = together(_trunk(clothes), *legs, *arms)
    # The lower foot carries the body.
    sole_m = min(corner[2] for surface in standing.surfaces for corner in surface.corners)
    body = standing.moved(0.0, 0.0, 0.0, -sole_m)
    return body + Piece((), (Solid("person", 0.0, 0.0, 0.22, BODY_RADIUS_M, 0.0, 0.0, 1.75),))


def _trunk(clothes: Clothes) -> Piece:
    cloth = f"cloth/{clothes.shirt}"
    trunk = column(0.16, _HIP_M - 0.06, 1.46, cloth, top_radius_m=0.22)
    neck = column(0.06, 1.44, 1.52, f"plain/{clothes.skin}")
    # The face, the front of the box, turned towards +x.
    head = box((0.18, 0.2, 0.26), f"plain/{clothes.hair}", base_m=1.5, front=f"face/{clothes.skin}")
    bag = box((0.3, 0.16, 0.42), f"fabric/{clothes.trousers}", base_m=0.98, front=f"poster/bag-{clothes.bag}")
    parts = [trunk, neck, head.moved(0.0, 0.0, 90.0)]
    return together(*parts, *([bag.moved(-0.26, 0.0, -90.0)] if clothes.bag else []))


def _leg(clothes: Clothes, hip_rad: float, knee_rad: float) -> Piece:
    cloth = f"fabric/{clothes.trousers}"
    shin = column(0.06, -_SHIN_M, 0.0, cloth, top_radius_m=0.075)
    shoe = box((0.27, 0.1, 0.08), "plain/#26221f", base_m=-_SHIN_M - 0.04).moved(0.06, 0.0)
    lower = _swung(shin + shoe, -knee_rad).moved(0.0, 0.0, 0.0, -_THIGH_M)
    thigh = column(0.075, -_THIGH_M, 0.0, cloth, top_radius_m=0.1)
    return _swung(thigh + lower, hip_rad).moved(0.0, 0.0, 0.0, _HIP_M)


def _arm(clothes: Clothes, shoulder_rad: float) -> Piece:
    sleeve = column(0.045, -_ARM_M + 0.1, 0.0, f"cloth/{clothes.shirt}", top_radius_m=0.06)
    hand = box((0.07, 0.05, 0.14), f"plain/{clothes.skin}", base_m=-_ARM_M - 0.03)
    return _swung(sleeve + hand, shoulder_rad).moved(0.0, 0.0, 0.0, _SHOULDER_M)


def _swung(piece: Piece, angle_rad: float) -> Piece:
    """Turn a limb that hangs from the origin forwards (towards +x) about the y axis."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return Piece(tuple(replace(surface, corners=_turned(surface, turn)) for surface in piece.surfaces), piece.solids)


def _turned(surface: Surface, turn: np.ndarray) -> tuple[Point3, Point3, Point3, Point3]:
    a, b, c, d = ((float(x), float(y), float(z)) for x, y, z in np.asarray(surface.corners) @ turn.T)
    return a, b, c, d
