"""The warm-up compiles all that mapping and localization need, so that nobody waits for it while walking."""

import dataclasses
import importlib
import pkgutil

import numpy as np
from numba.core.registry import CPUDispatcher

import navcore.slam
from navcore.settings import LocalizationSettings
from navcore.slam.keyframes import SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.mapper import Mapper
from navcore.slam.rehearsal import REHEARSAL_CAMERA, sliding_frames


def _compiled() -> dict[str, list[object]]:
    modules = [
        importlib.import_module(f"navcore.slam.{info.name}") for info in pkgutil.iter_modules(navcore.slam.__path__)
    ]
    return {
        f"{kernel.py_func.__module__}.{kernel.py_func.__name__}": list(kernel.signatures)
        for module in modules
        for kernel in vars(module).values()
        if isinstance(kernel, CPUDispatcher)
    }


def test_nothing_is_compiled_after_the_warm_up() -> None:
    navcore.slam.warm_up()
    before = _compiled()
    distorted = dataclasses.replace(REHEARSAL_CAMERA, distortion=(0.05, -0.02, 0.001, 0.0, 0.0))
    mapper = Mapper(distorted, SlamCamera.of(distorted, 60.0), 500)
    for frame, _ in sliding_frames(40, step_px=12, seed=5):
        frame.depth_m[:60] = np.nan
        mapper.add(frame)
    localizer = Localizer(mapper.finish(), distorted, LocalizationSettings())
    for number, (frame, _) in enumerate(sliding_frames(24, step_px=12, seed=5)):
        if number % 5:
            localizer.locate(frame)
    assert _compiled() == before
