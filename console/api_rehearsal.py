"""The API of rehearsals: what would be heard on a way of the draft, where and when, and how it sounds."""

from __future__ import annotations

from typing import Any

import msgspec
from fastapi import FastAPI, Response

from console.bodies import RehearsalBody
from console.described import answers_with
from console.requests import json_response
from console.services import Services
from navcore.rehearsal.rehearsing import Rehearsal, Utterance
from navcore.settings import Settings

_SOUNDS_PATH = "/api/rehearsals/sounds"
_WAV_HEADERS = {"Cache-Control": "private, max-age=86400, immutable"}
"""What a key stands for never changes."""


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""

    @app.post("/api/rehearsals")
    def rehearsal(body: RehearsalBody) -> Response:
        graph = services.model.graph
        changes = {f"cues.{name}": value for name, value in body.cues().items()}
        done = services.rehearsals.rehearse(graph, body.start, body.destination, Settings().changed(changes))
        return json_response(_view(services, done, graph.version))

    @app.get(_SOUNDS_PATH + "/{key}", response_class=Response, responses=answers_with("audio/wav"))
    def sound(key: str) -> Response:
        return Response(services.sounds.wav(key), media_type="audio/wav", headers=_WAV_HEADERS)


def _view(services: Services, rehearsal: Rehearsal, graph_version: int) -> dict[str, Any]:
    return {
        "graph_version": graph_version,
        "start": rehearsal.start_poi_id,
        "destination": rehearsal.destination_poi_id,
        "language": rehearsal.language,
        "voice": "espeak-ng" if services.sounds.has_voice else "browser",
        "arrived": rehearsal.arrived,
        "refusal": rehearsal.refusal,
        "total_s": rehearsal.total_s,
        "length_m": rehearsal.length_m,
        "edge_ids": rehearsal.edge_ids,
        "utterances": [_utterance_view(services, each, rehearsal) for each in rehearsal.utterances],
    }


def _utterance_view(services: Services, utterance: Utterance, rehearsal: Rehearsal) -> dict[str, Any]:
    key = services.sounds.key_of(utterance.cue, rehearsal.language)
    values: dict[str, Any] = msgspec.to_builtins(utterance)
    return {**values, "sound": None if key is None else f"{_SOUNDS_PATH}/{key}"}
