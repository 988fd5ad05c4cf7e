"""The options that every command with a simulated walker takes, checked before anything is begun."""

from __future__ import annotations

import argparse
import math

PICTURE_SIZES_PX = ((320, 240), (640, 480))
LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 1.0, 60.0
MAX_SEED = 2**32 - 1


def add_simulation_options(parser: argparse._ActionsContainer, *, seed: int) -> None:
    """Add ``--seed`` (with its default), ``--size`` and ``--rate-hz``."""
    parser.add_argument(
        "--seed", type=seed_number, default=seed, help="of walker, noise and gait (default: %(default)s)"
    )
    parser.add_argument(
        "--size", type=picture_size, default=PICTURE_SIZES_PX[0], metavar="WxH", help="320x240 (default) or 640x480"
    )
    parser.add_argument("--rate-hz", type=frame_rate_hz, default=10.0, help="frames per second (default: %(default)g)")


def seed_number(text: str) -> int:
    """Read a seed. Raises argparse.ArgumentTypeError."""
    if not text.isdecimal() or len(text) > len(str(MAX_SEED)) or int(text) > MAX_SEED:
        raise argparse.ArgumentTypeError(f"{text!r} is no seed: give a whole number from 0 to {MAX_SEED}")
    return int(text)


def picture_size(text: str) -> tuple[int, int]:
    """Read ``320x240``. Raises argparse.ArgumentTypeError."""
    for size in PICTURE_SIZES_PX:
        if text.replace("×", "x") == f"{size[0]}x{size[1]}":
            return size
    raise argparse.ArgumentTypeError(f"{text!r} is no picture size of the simulation: write 320x240 or 640x480")


def frame_rate_hz(text: str) -> float:
    """Read a frame rate. Raises argparse.ArgumentTypeError."""
    rate_hz = number(text)
    if not LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ:
        raise argparse.ArgumentTypeError(
            f"a camera cannot run at {text} Hz here: give {LOWEST_RATE_HZ:g} to {HIGHEST_RATE_HZ:g}"
        )
    return rate_hz


def positive_number(text: str) -> float:
    """Read a number greater than 0. Raises argparse.ArgumentTypeError."""
    value = number(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"{text!r} will not do: give a number greater than 0")
    return value


def number(text: str) -> float:
    """Read a number. Raises argparse.ArgumentTypeError for text, infinity and NaN."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is no number: give one such as 10")
    return value
