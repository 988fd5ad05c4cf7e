"""Boards to calibrate lenses with: a checkerboard, or a ChArUco board, found in pictures and drawn to be printed.

A ChArUco board (OpenCV ``cv2.aruco.CharucoBoard``) is found where only a part of it is in the picture, so that corners
of the picture are reached; a checkerboard must be in it as a whole. Both are named by their squares, columns × rows.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.types import ImageGrey

MIN_CORNERS = 8
"""Fewer corners of a board say little about a lens."""
DOTS_PER_INCH = 300
_MARGIN_M = 0.010
_M_PER_INCH = 0.0254
_MAX_PIXELS = 60_000_000
_FORM = re.compile(r"(checkerboard|charuco):(\d{1,2})[x×](\d{1,2}):([\d.]+)mm(?::([\d.]+)mm)?")
_HOW = (
    "write checkerboard:10x7:25mm or charuco:8x6:35mm:26mm (columns x rows of squares, side of a square, of a marker)"
)


@dataclass(frozen=True, slots=True)
class Board:
    """A printed board."""

    kind: Literal["checkerboard", "charuco"]
    columns: int
    """Squares from left to right."""
    rows: int
    square_m: float
    """Side of a square."""
    marker_m: float = 0.0
    """Side of a marker; 0 on a checkerboard."""

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of all squares together."""
        return self.columns * self.square_m, self.rows * self.square_m

    def words(self) -> str:
        """Return it as it is written on the command line."""
        marker = f":{1000 * self.marker_m:g}mm" if self.kind == "charuco" else ""
        return f"{self.kind}:{self.columns}x{self.rows}:{1000 * self.square_m:g}mm{marker}"


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """The corners of a board that are seen in one picture."""

    name: str
    """Of the picture, for people."""
    corners_m: FloatArray
    """Corners (n, 3) in the board's frame; z is 0."""
    pixels: FloatArray
    """Where they are seen (n, 2)."""


def board_named(text: str) -> Board:
    """Read a board from the command line. Raises InputError."""
    match = _FORM.fullmatch(text)
    if match is None:
        raise InputError(f"{text!r} names no board: {_HOW}.")
    kind: Literal["checkerboard", "charuco"] = "charuco" if match[1] == "charuco" else "checkerboard"
    columns, rows = int(match[2]), int(match[3])
    try:
        square_m, marker_m = float(match[4]) / 1000.0, float(match[5] or 0.0) / 1000.0
    except ValueError as error:
        raise InputError(f"{text!r} names no board: {_HOW}.") from error
    if not (4 <= columns <= 40 and 4 <= rows <= 40 and 0.003 <= square_m <= 0.5):
        raise InputError(f"A board {text} will not do: it needs 4 to 40 squares a side, of 3 to 500 mm.")
    if kind == "charuco" and not 0.3 * square_m <= marker_m <= 0.95 * square_m:
        raise InputError(f"The board {text} needs markers of 30 to 95 % of a square: {_HOW}.")
    if kind == "checkerboard" and columns % 2 == rows % 2:
        raise InputError(
            f"The board {text} looks the same upside down: take an even number of columns and an odd one of rows."
        )
    return Board(kind, columns, rows, square_m, marker_m)


def find_board(board: Board, grey: ImageGrey, name: str) -> BoardView | None:
    """Return the corners of the board in a picture; None where too few are seen."""
    found = _charuco_corners(board, grey) if board.kind == "charuco" else _checkerboard_corners(board, grey)
    if found is None or len(found[1]) < MIN_CORNERS:
        return None
    corners_m, pixels = found
    return BoardView(name, corners_m, pixels)


def _checkerboard_corners(board: Board, grey: ImageGrey) -> tuple[FloatArray, FloatArray] | None:
    inner = (board.columns - 1, board.rows - 1)
    is_found, corners = cv2.findChessboardCornersSB(grey, inner, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not is_found:
        return None
    columns, rows = np.meshgrid(np.arange(inner[0]), np.arange(inner[1]))
    grid = np.stack([columns.ravel(), rows.ravel(), np.zeros(columns.size)], axis=1).astype(np.float64)
    return grid * board.square_m, np.asarray(corners, np.float64).reshape(-1, 2)


def _charuco_corners(board: Board, grey: ImageGrey) -> tuple[FloatArray, FloatArray] | None:
    charuco = _charuco(board)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco).detectBoard(grey)
    if corners is None or ids is None or len(ids) == 0:
        return None
    places_m = np.asarray(charuco.getChessboardCorners(), np.float64)[np.asarray(ids).ravel()]
    # Corners that all lie on one line of the board say nothing of the plane that it lies in.
    if np.ptp(places_m[:, 0]) < board.square_m / 2 or np.ptp(places_m[:, 1]) < board.square_m / 2:
        return None
    return places_m, np.asarray(corners, np.float64).reshape(-1, 2)


def _charuco(board: Board) -> cv2.aruco.CharucoBoard:
    marker_count = board.columns * board.rows // 2
    family = cv2.aruco.DICT_5X5_100 if marker_count <= 100 else cv2.aruco.DICT_5X5_1000
    dictionary = cv2.aruco.getPredefinedDictionary(family)
    return cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, dictionary)


# -------------------------------------------------------------------------------------------------- to print
def board_picture(board: Board, dots_per_inch: float = DOTS_PER_INCH) -> ImageGrey:
    """Return the board as a grey picture (h, w) with a white margin of one centimetre. Raises InputError."""
    scale = dots_per_inch / _M_PER_INCH
    margin_px, square_px = round(_MARGIN_M * scale), round(board.square_m * scale)
    width_px, height_px = board.columns * square_px, board.rows * square_px
    if square_px < 8 or (width_px + 2 * margin_px) * (height_px + 2 * margin_px) > _MAX_PIXELS:
        raise InputError(f"The board {board.words()} cannot be drawn at {dots_per_inch:g} dots per inch: change one.")
    if board.kind == "charuco":
        squares = _charuco(board).generateImage((width_px, height_px), marginSize=0, borderBits=1)
    else:
        columns, rows = np.meshgrid(np.arange(board.columns), np.arange(board.rows))
        tiles = np.where((columns + rows) % 2 == 0, 0, 255).astype(np.uint8)
        squares = np.kron(tiles, np.ones((square_px, square_px), np.uint8))
    picture: ImageGrey = np.pad(np.asarray(squares, np.uint8), margin_px, constant_values=255)
    label = f"{board.words()}   print at 100 %, then measure a square"
    cv2.putText(
        picture, label, (margin_px, picture.shape[0] - margin_px // 4), cv2.FONT_HERSHEY_SIMPLEX,
        0.012 * margin_px, 120, max(1, margin_px // 60), cv2.LINE_AA,
    )  # fmt: skip
    return picture


def png_bytes(picture: ImageGrey, dots_per_inch: float = DOTS_PER_INCH) -> bytes:
    """Return a picture as a PNG file that says how large it is to be printed."""
    encoded = cv2.imencode(".png", picture)[1].tobytes()
    per_m = round(dots_per_inch / _M_PER_INCH)
    body = b"pHYs" + struct.pack(">IIB", per_m, per_m, 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    # The header ends after 8 bytes of signature and 25 of IHDR; OpenCV's own pHYs, where it writes one, says nothing.
    return encoded[:33] + chunk + _without_chunk(encoded[33:], b"pHYs")


def _without_chunk(chunks: bytes, kind: bytes) -> bytes:
    kept, at = b"", 0
    while at < len(chunks):
        end = at + 12 + int.from_bytes(chunks[at : at + 4], "big")
        kept += b"" if chunks[at + 4 : at + 8] == kind else chunks[at:end]
        at = end
    return kept


def pdf_bytes(picture: ImageGrey, dots_per_inch: float = DOTS_PER_INCH) -> bytes:
    """Return a picture as a PDF of one page of just its size (PDF 1.4, ISO 32000-1)."""
    height_px, width_px = picture.shape
    width_pt, height_pt = (72.0 * side / dots_per_inch for side in (width_px, height_px))
    packed = zlib.compress(np.ascontiguousarray(picture).tobytes(), 9)
    drawing = f"{width_pt:.4f} 0 0 {height_pt:.4f} 0 0 cm /B Do".encode()
    image = f"<< /Type /XObject /Subtype /Image /Width {width_px} /Height {height_px} /ColorSpace /DeviceGray"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width_pt:.4f} {height_pt:.4f}] /Contents 4 0 R"
        " /Resources << /XObject << /B 5 0 R >> >> >>".encode(),
        _stream(b"<<", drawing),
        _stream(f"{image} /BitsPerComponent 8 /Filter /FlateDecode".encode(), packed),
    ]
    return _pdf_of(objects)


def _stream(head: bytes, data: bytes) -> bytes:
    return head + f" /Length {len(data)} >>\nstream\n".encode() + data + b"\nendstream"


def _pdf_of(objects: list[bytes]) -> bytes:
    out, offsets = b"%PDF-1.4\n", []
    for number, body in enumerate(objects, 1):
        offsets.append(len(out))
        out += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    table = "".join(f"{offset:010d} 00000 n \n" for offset in offsets)
    count = len(objects) + 1
    tail = f"xref\n0 {count}\n0000000000 65535 f \n{table}trailer\n<< /Size {count} /Root 1 0 R >>\n"
    return out + f"{tail}startxref\n{len(out)}\n%%EOF\n".encode()


def shown_share(views: list[BoardView], width_px: int, height_px: int) -> tuple[float, NDArray[np.bool_]]:
    """Return the share of the picture's cells (6 × 8) in which corners were seen, and which (6, 8)."""
    seen = np.zeros((6, 8), dtype=np.bool_)
    for view in views:
        column = np.clip(view.pixels[:, 0] / width_px * 8, 0, 7).astype(np.int64)
        row = np.clip(view.pixels[:, 1] / height_px * 6, 0, 5).astype(np.int64)
        seen[row, column] = True
    return float(seen.mean()), seen


def moved_px(one: BoardView, other: BoardView) -> float:
    """Return how far the middle of the seen corners has moved or the board has grown, pixels: is it another view?"""
    shift = one.pixels.mean(axis=0) - other.pixels.mean(axis=0)
    growth = one.pixels.std(axis=0) - other.pixels.std(axis=0)
    return max(math.hypot(*shift), math.hypot(*growth))
