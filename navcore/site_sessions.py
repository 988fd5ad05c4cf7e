"""The recordings that a site is made of: its sessions."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from navcore.types import CameraIntrinsics

MAX_SESSIONS = 64
"""Each session is one bit of a cloud point's mask."""

SessionKind = Literal["recording", "import"]


class Session(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was recorded, or brought from elsewhere, at one time. Its number is its place in the site's list."""

    id: Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
    """Made from the contents: the same recording has the same id anywhere."""
    name: Annotated[str, msgspec.Meta(max_length=200)]
    date: Annotated[str, msgspec.Meta(max_length=40)] = ""
    """As it was given; empty where nobody said."""
    kind: SessionKind = "recording"
    frame_count: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Frames of the recording; 0 for what was imported."""
    camera: CameraIntrinsics | None = None
    """The camera that recorded it."""


class SessionTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The sessions of a site, and which of them each road comes from."""

    sessions: Annotated[tuple[Session, ...], msgspec.Meta(min_length=1, max_length=MAX_SESSIONS)]
    road_sessions: tuple[int, ...] = ()
    """For each road, the number of its session."""
