"""A frame that cannot be is refused with a sentence, and leaves what is known as it was."""

import dataclasses
from itertools import islice

import numpy as np
import pytest

from navcore.errors import SensorError
from navcore.settings import LocalizationSettings
from navcore.slam.keyframes import SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.mapper import Mapper
from navcore.slam.rehearsal import REHEARSAL_CAMERA, sliding_frames
from navcore.slam.slam_map import SlamMap
from navcore.types import Frame, LocalizationQuality


@pytest.fixture(scope="module")
def walk() -> list[Frame]:
    return [frame for frame, _ in islice(sliding_frames(30), 20)]


def _mapper() -> Mapper:
    return Mapper(REHEARSAL_CAMERA, SlamCamera.of(REHEARSAL_CAMERA, 100.0), 600)


@pytest.fixture(scope="module")
def slam_map(walk: list[Frame]) -> SlamMap:
    mapper = _mapper()
    for frame in walk:
        mapper.add(frame)
    return mapper.finish()


BAD = {
    "no time": lambda frame: dataclasses.replace(frame, stamp_s=float("nan")),
    "endless time": lambda frame: dataclasses.replace(frame, stamp_s=float("inf")),
    "small colour": lambda frame: dataclasses.replace(frame, colour_rgb=frame.colour_rgb[::2, ::2]),
    "grey": lambda frame: dataclasses.replace(frame, colour_rgb=frame.colour_rgb[..., 0]),
    "small depth": lambda frame: dataclasses.replace(frame, depth_m=frame.depth_m[::2, ::2]),
}


@pytest.mark.parametrize("what", BAD)
def test_a_frame_that_cannot_be_changes_nothing(slam_map: SlamMap, walk: list[Frame], what: str) -> None:
    localizer, mapper = Localizer(slam_map, REHEARSAL_CAMERA, LocalizationSettings()), _mapper()
    for frame in walk[:6]:
        localizer.locate(frame)
        mapper.add(frame)
    bad = BAD[what](walk[6])
    for take in (localizer.locate, mapper.add):
        with pytest.raises(SensorError, match="again"):
            take(bad)
    assert localizer.locate(walk[6]).quality is LocalizationQuality.LOCALIZED
    assert mapper.add(walk[6])


@pytest.mark.parametrize("number", [5, 3])
def test_a_map_is_made_of_no_old_frames(walk: list[Frame], number: int) -> None:
    mapper = _mapper()
    for frame in walk[:6]:
        mapper.add(frame)
    with pytest.raises(SensorError, match="old pictures"):
        mapper.add(walk[number])
    assert mapper.add(walk[6])


def test_a_frame_that_comes_again_and_again_confirms_nothing(slam_map: SlamMap, walk: list[Frame]) -> None:
    localizer = Localizer(slam_map, REHEARSAL_CAMERA, LocalizationSettings())
    for _ in range(5):
        assert localizer.locate(walk[6]).quality is not LocalizationQuality.LOCALIZED


@pytest.mark.parametrize("impossible_m", [0.0, -1.0, np.inf, -np.inf])
def test_impossible_depth_is_unknown_depth(slam_map: SlamMap, walk: list[Frame], impossible_m: float) -> None:
    def poses(depth_m: float) -> list[bytes]:
        localizer, mapper, told = Localizer(slam_map, REHEARSAL_CAMERA, LocalizationSettings()), _mapper(), []
        for frame in walk[:8]:
            depth = frame.depth_m.copy()
            depth[80:200, 100:220] = depth_m
            holed = dataclasses.replace(frame, depth_m=depth)
            mapper.add(holed)
            pose = localizer.locate(holed).world_from_camera
            told.append(b"" if pose is None else pose.matrix.tobytes())
        return [*told, mapper.world_from_camera.tobytes()]

    assert poses(impossible_m) == poses(np.nan)
