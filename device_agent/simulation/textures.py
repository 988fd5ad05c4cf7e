"""The library of textures: which painter makes which, at which fineness, and the atlas that the renderer reads.

A texture's name is ``kind/label``. Kinds with a tile size repeat over the surface; the others are painted once over the
whole surface. The same name, size and seed give the same pixels.
"""

from __future__ import annotations

import enum
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from device_agent.simulation import patterns, posters, prints
from device_agent.simulation.patterns import Image, Rng
from device_agent.simulation.shapes import Surface
from navcore.errors import InputError

MAX_LEVELS = 12


class Material(enum.IntEnum):
    """How the depth camera gets on with a surface."""

    MATT = 0
    SHINY = 1
    """Dark or glossy: the pattern projector's light does not come back from much of it."""
    LIT = 2
    """Shines by itself: as bright as it is painted, whatever the lamps do."""
    ABSORBING = 3
    """Velvet, soot, black foam: none of the projector's light comes back."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """One kind of texture."""

    painter: Callable[[Rng, int, int, str], Image]
    px_per_m: float
    tile_m: float | None = None
    """Side of the square that repeats; None where each surface is painted as a whole."""
    material: Material = Material.MATT


PATTERNS: dict[str, Pattern] = {
    "paint": Pattern(patterns.paint, 100, 3.0),
    "plain": Pattern(patterns.plain, 60, 1.0),
    "fabric": Pattern(patterns.fabric, 160, 1.6),
    "metal": Pattern(patterns.metal, 160, 1.6, Material.SHINY),
    "dark": Pattern(patterns.plain, 60, 1.0, Material.SHINY),
    "velvet": Pattern(patterns.plain, 60, 1.0, Material.ABSORBING),
    "veneer": Pattern(patterns.veneer, 140),
    "wood": Pattern(patterns.wood, 140),
    "brick": Pattern(patterns.brick, 150),
    "carpet": Pattern(patterns.carpet, 125),
    "terrazzo": Pattern(patterns.terrazzo, 125),
    "tiles": Pattern(patterns.tiles, 125),
    "wallpaper": Pattern(patterns.wallpaper, 110),
    "cloth": Pattern(patterns.cloth, 160),
    "concrete": Pattern(patterns.concrete, 100),
    "ceiling": Pattern(patterns.ceiling, 60, 2.4),
    "leaf": Pattern(patterns.leaf, 200),
    "lamp": Pattern(patterns.lamp, 40, material=Material.LIT),
    "poster": Pattern(posters.poster, 330),
    "notice": Pattern(posters.notice_board, 280),
    "sign": Pattern(prints.sign, 400),
    "exit": Pattern(prints.exit_sign, 300, material=Material.LIT),
    "door": Pattern(prints.door, 190),
    "screen": Pattern(prints.screen, 320, material=Material.LIT),
    "books": Pattern(prints.books, 200),
    "bottles": Pattern(prints.bottles, 150),
    "window": Pattern(prints.window, 110, material=Material.LIT),
    "vending": Pattern(prints.vending, 200),
    "face": Pattern(prints.face, 200),
}


@dataclass(frozen=True, slots=True, eq=False)
class TextureAtlas:
    """All textures with their mip levels, in one array. ``t`` textures, ``MAX_LEVELS`` levels each.

    Level k is about half as wide as level k − 1; textures with fewer levels repeat their last one.
    """

    texels: NDArray[np.uint32]
    """Flat: red + 2⁸ green + 2¹⁶ blue of each texel, row after row, level after level."""
    offset: NDArray[np.int64]
    """Index (t, levels) of the first texel of each level in ``texels``."""
    width: NDArray[np.int32]
    height: NDArray[np.int32]
    shrink: NDArray[np.float32]
    """Width and height (t, levels, 2) of each level, relative to level 0."""
    px_per_m: NDArray[np.float32]
    """Fineness (t, 2) of level 0 along the width and the height."""
    repeats: NDArray[np.uint8]
    material: NDArray[np.uint8]
    """:class:`Material` of each texture (t,)."""
    index: dict[tuple[str, int, int], int]
    """From (name, width, height at level 0) to the texture's number."""


def texture_key(surface: Surface) -> tuple[str, int, int]:
    """Return what tells textures apart: the name, and the size in pixels at level 0.

    Raises InputError for an unknown kind.
    """
    kind = surface.texture.split("/", 1)[0]
    if kind not in PATTERNS:
        raise InputError(f"There is no texture of kind {kind!r}: use one of {', '.join(sorted(PATTERNS))}.")
    pattern = PATTERNS[kind]
    size_m = (pattern.tile_m, pattern.tile_m) if pattern.tile_m is not None else surface.size_m
    # At least 16 pixels, for painters that need room to draw.
    return surface.texture, *(max(16, round(length * pattern.px_per_m)) for length in size_m)  # type: ignore[return-value]  # two lengths


def build_atlas(surfaces: Iterable[Surface], seed: int) -> TextureAtlas:
    """Paint every texture that the surfaces use, and its mip levels."""
    sizes = {texture_key(surface): surface.size_m for surface in surfaces}
    index = {key: number for number, key in enumerate(sizes)}
    chunks: list[NDArray[np.uint32]] = []
    offset = np.zeros((len(index), MAX_LEVELS), np.int64)
    width, height = np.ones((2, len(index), MAX_LEVELS), np.int32)
    fineness = np.ones((len(index), 2), np.float32)
    begin = 0
    for key, number in index.items():
        levels = _mip_levels(paint_texture(key, seed))
        for level in range(MAX_LEVELS):
            image = levels[min(level, len(levels) - 1)]
            height[number, level], width[number, level] = image.shape[:2]
            if level < len(levels):
                chunks.append(_packed(image))
                offset[number, level] = begin
                begin += chunks[-1].size
            else:
                offset[number, level] = offset[number, level - 1]
        tile_m = PATTERNS[key[0].split("/", 1)[0]].tile_m
        size_m = sizes[key] if tile_m is None else (tile_m, tile_m)
        fineness[number] = key[1] / size_m[0], key[2] / size_m[1]
    used = [PATTERNS[name.split("/", 1)[0]] for name, _, _ in index]
    return TextureAtlas(
        np.concatenate(chunks),
        offset,
        width,
        height,
        np.stack([width / width[:, :1], height / height[:, :1]], axis=2).astype(np.float32),
        fineness,
        np.array([pattern.tile_m is not None for pattern in used], np.uint8),
        np.array([pattern.material for pattern in used], np.uint8),
        index,
    )


def paint_texture(key: tuple[str, int, int], seed: int) -> Image:
    """Paint one texture at level 0."""
    name, width_px, height_px = key
    kind, _, label = name.partition("/")
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    return np.ascontiguousarray(PATTERNS[kind].painter(rng, width_px, height_px, label))


def _packed(image: Image) -> NDArray[np.uint32]:
    flat = image.reshape(-1, 3).astype(np.uint32)
    return (flat[:, 0] | flat[:, 1] << 8 | flat[:, 2] << 16).astype(np.uint32)


def _mip_levels(image: Image) -> list[Image]:
    levels = [image]
    while len(levels) < MAX_LEVELS and max(levels[-1].shape[:2]) > 1:
        height_px, width_px = levels[-1].shape[:2]
        smaller = cv2.resize(levels[-1], (max(1, width_px // 2), max(1, height_px // 2)), interpolation=cv2.INTER_AREA)
        levels.append(np.ascontiguousarray(smaller))
    return levels
