"""``vbr demo --headless``: one walk in lock step with the simulation, and its figures."""

from __future__ import annotations

import argparse
import math
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from device_agent.recording.options import recording_options
from device_agent.scenario_options import scenario_from
from navcore.settings import Settings, parse_assignment
from navcore.site import load_site


def walk_figures(arguments: argparse.Namespace, site_folder: Path) -> dict[str, Any]:
    """Walk from one place to another and return what came of it, ready to be printed."""
    from device_agent.adapters.displays import PngDisplay
    from device_agent.adapters.wav_file import WavFileOutput
    from device_agent.places import find_place
    from device_agent.recording.recorder import WalkRecorder
    from device_agent.simulation.office_floor import office_floor
    from device_agent.walk import run_walk
    from navcore.espeak import Speech

    settings = Settings().changed(dict(parse_assignment(text) for text in arguments.set))
    site = load_site(site_folder)
    # Before the file of an earlier walk is overwritten.
    find_place(site.poi_graph, arguments.to)
    with ExitStack() as stack:
        output = WavFileOutput(arguments.wav, Speech(settings.cues.language)) if arguments.wav is not None else None
        display = PngDisplay(arguments.overlay) if arguments.overlay is not None else None
        for each in (output, display):
            if each is not None:
                stack.callback(each.close)
        record = recording_options(arguments)
        tap = None if record is None else WalkRecorder(record)
        if tap is not None:
            stack.callback(tap.close)
        result = run_walk(
            site,
            office_floor(),
            arguments.start,
            arguments.to,
            settings=settings,
            seed=arguments.seed,
            max_s=arguments.max_s,
            rate_hz=arguments.rate_hz,
            size_px=arguments.size,
            output=output,
            display=display,
            scenario=scenario_from(arguments),
            tap=tap,
        )
    return {
        "arrived": result.arrived,
        "contacts": result.contacts,
        "outcome": result.outcome,
        "deviation_max_m": _rounded(result.deviation_max_m),
        "deviation_mean_m": _rounded(result.deviation_mean_m),
        "deviation_variance_m2": _rounded(result.deviation_variance_m2),
        "seconds": _rounded(result.seconds),
        "cycles": result.cycles,
        "cycle_median_ms": _rounded(result.median_ms),
        "cycle_p95_ms": _rounded(result.p95_ms),
        "route_length_m": _rounded(result.route_length_m),
        "localized_fraction": _rounded(result.localized_fraction),
        "localization_rmse_m": _rounded(result.localization_rmse_m),
        "end_distance_m": _rounded(result.end_distance_m),
    }


def _rounded(value: float) -> float | None:
    """Four decimals; None for what is not known, since JSON has no NaN."""
    return round(value, 4) if math.isfinite(value) else None
