"""How a walking person's head moves: bob, sway, and the small turns that go with them.

Sources: M. Hirasaki, S. Moore, T. Raphan, B. Cohen, "Effects of walking velocity on vertical head and body movements
during locomotion", Exp. Brain Res. 127 (1999): the head bobs at the step frequency, about 2 Hz, a few centimetres, and
pitches by 1–2° against it. T. Pozzo, A. Berthoz, L. Lefort, "Head stabilization during various locomotor tasks in
humans", Exp. Brain Res. 82 (1990). H. Menz, S. Lord, R. Fitzpatrick, "Acceleration patterns of the head and pelvis when
walking on level and irregular surfaces", Gait & Posture 18 (2003): side-to-side at half the step frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from navcore.geometry import Transform, world_from_camera_at


@dataclass(frozen=True, slots=True)
class Gait:
    """Parameters of head motion while walking at ``full_speed_mps`` or faster; slower walking moves the head less."""

    step_hz: float = 1.8
    """Step frequency (Hirasaki et al.: 1.4–2.2 Hz between 0.6 and 1.8 m/s)."""
    full_speed_mps: float = 0.8
    bob_m: float = 0.020
    """Amplitude up and down, at the step frequency."""
    sway_m: float = 0.015
    """Amplitude to the sides, at half the step frequency."""
    pitch_deg: float = 1.2
    """Amplitude of nodding, against the bob."""
    yaw_deg: float = 1.2
    """Amplitude of turning, at half the step frequency."""
    roll_deg: float = 1.0
    """Amplitude of leaning, at half the step frequency."""
    idle_m: float = 0.004
    """Sway of a standing person."""
    idle_deg: float = 0.4


@dataclass(frozen=True, slots=True)
class HeadMount:
    """Where the camera sits: on the glasses of a grown person, tilted to see the floor ahead."""

    eye_height_m: float = 1.60
    forward_m: float = 0.10
    """Before the body's vertical axis."""
    pitch_down_deg: float = 15.0
    yaw_left_deg: float = 0.0
    """How far it is turned aside of where the body faces."""


USUAL_GAIT = Gait()
USUAL_MOUNT = HeadMount()


def advance_phase(phase_rad: float, speed_mps: float, dt_s: float, gait: Gait) -> float:
    """Return the phase of the stride (two steps are 2π) after a while at a speed; slow walking takes slower steps."""
    share = min(1.0, speed_mps / gait.full_speed_mps)
    # Step length and step frequency both shrink, about with the square root of the speed.
    return (phase_rad + math.pi * gait.step_hz * math.sqrt(max(0.0, share)) * dt_s) % math.tau


def head_pose(
    x_m: float,
    y_m: float,
    heading_rad: float,
    time_s: float,
    phase_rad: float,
    speed_mps: float,
    gait: Gait = USUAL_GAIT,
    mount: HeadMount = USUAL_MOUNT,
) -> Transform:
    """Return ``world_from_camera`` of the head of somebody whose body is at (x, y) and faces a heading."""
    share = min(1.0, max(0.0, speed_mps / gait.full_speed_mps))
    stride, step = math.sin(phase_rad), math.sin(2 * phase_rad)
    idle_a, idle_b = math.sin(0.31 * math.tau * time_s), math.sin(0.23 * math.tau * time_s + 1.0)
    side_m = share * gait.sway_m * stride + gait.idle_m * idle_a
    up_m = share * gait.bob_m * step
    turned_deg = share * gait.yaw_deg * math.sin(phase_rad + 0.6) + gait.idle_deg * idle_b
    yaw_rad = heading_rad + math.radians(mount.yaw_left_deg + turned_deg)
    pitch_rad = math.radians(mount.pitch_down_deg + share * gait.pitch_deg * step + gait.idle_deg * idle_a)
    roll_rad = math.radians(share * gait.roll_deg * math.sin(phase_rad + 0.2))
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    position = (
        x_m + mount.forward_m * c - side_m * s,
        y_m + mount.forward_m * s + side_m * c,
        mount.eye_height_m + up_m,
    )
    return world_from_camera_at(position, yaw_rad, pitch_rad, roll_rad)
