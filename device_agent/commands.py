"""The sub-commands that the device's package brings to ``vbr``.

Every module named here has ``add_commands(subparsers)`` and imports what is heavy only when its command runs, so that
``vbr --help`` answers at once.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util

_MODULES = (
    "device_agent.device_command",
    "device_agent.calibrate_command",
    "device_agent.consent_command",
    "device_agent.doctor_command",
    "device_agent.logs_command",
    "device_agent.map_commands",
    "device_agent.rehearse_command",
    "device_agent.simulation_commands",
    "device_agent.walks_command",
    "device_agent.maintenance_commands",
    "device_agent.demo",
    "device_agent.experiments_command",
)


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add every command of this package."""
    for name in _MODULES:
        if importlib.util.find_spec(name) is not None:
            importlib.import_module(name).add_commands(subparsers)
