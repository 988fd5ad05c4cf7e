"""What the API takes in: strict models; anything else is a 400 with one sentence."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StrictBool,
    StrictFloat,
    StrictInt,
    StrictStr,
    model_validator,
)

from console.retention import MAX_DAYS, MIN_DAYS
from console.roles import Role
from console.tuning import TRIAL_S
from navcore.cues.directions import DirectionStyle
from navcore.cues.table import Verbosity
from navcore.cues.texts import Language
from navcore.errors import InputError
from navcore.plain_text import refuse_hidden


def _refuse_hidden(text: str) -> str:
    try:
        refuse_hidden("it", text, may_break=True)
    except InputError as error:
        raise ValueError(str(error)) from error
    return text


_PLAIN = AfterValidator(_refuse_hidden)
Password = Annotated[str, Field(max_length=1000)]
PersonName = Annotated[str, Field(min_length=1, max_length=200)]
Token = Annotated[str, Field(min_length=1, max_length=200)]

MAX_NUMBER = 1 << 53
"""As far as every database and language in use counts exactly."""
Number = Annotated[int, Field(ge=0, le=MAX_NUMBER)]
"""Names a version, a revision or a person."""
MapMetres = Annotated[float, Field(ge=-100_000.0, le=100_000.0, allow_inf_nan=False)]


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class SignInBody(_Body):
    """Name and password."""

    name: PersonName
    password: Password


class LinkBody(_Body):
    """The token of a one-time link."""

    token: Token


class FirstBody(_Body):
    """What somebody with a one-time link chooses; the name counts only where the link makes a new admin."""

    token: Token
    name: Annotated[str, Field(max_length=200)] = ""
    password: Password


class AcknowledgeBody(_Body):
    """What somebody says who has seen an alert."""

    note: Annotated[str, Field(max_length=300), _PLAIN] = ""


class ShelveBody(_Body):
    """For how long an alert is to keep silent, and why."""

    minutes: Literal[5, 10, 15]
    reason: Annotated[str, Field(min_length=1, max_length=300), _PLAIN]


class EndWatchBody(_Body):
    """Why a device that led somebody, and has gone, is missed no more."""

    why: Annotated[str, Field(min_length=1, max_length=300), _PLAIN]


class ViewBody(_Body):
    """What the page asks of the scene inside it: a place or a point of the floor to fly to, a device to show, or
    where the camera is to go.

    ``kind`` and ``id`` name what is selected at the point.
    """

    fly_to: Annotated[str, Field(max_length=64)] | None = None
    point: tuple[MapMetres, MapMetres] | None = None
    kind: Literal["poi", "edge", "road"] | None = None
    id: Annotated[str, Field(max_length=64)] = ""
    follow: Annotated[str, Field(max_length=120)] | None = None
    camera: Literal["walker", "overview"] | None = None


class PastViewBody(_Body):
    """An instant of a past walk, or of an incident, for the scene."""

    walk: Annotated[str, Field(max_length=120)] = ""
    incident: Annotated[str, Field(max_length=64)] = ""
    at_s: Annotated[float, Field(ge=0.0, le=1e6, allow_inf_nan=False)]
    clock: Annotated[str, Field(pattern=r"^[0-9]{2}:[0-9]{2}:[0-9]{2}$")]
    """The time of day of then, where the person is."""


class PresenceBody(_Body):
    """What a page's window does: it says so every few seconds, and at once when that changes."""

    window: Annotated[str, Field(min_length=1, max_length=64)]
    doing: Literal["looking", "editing", "dragging", "drawing", "gone"] = "looking"
    kind: Literal["poi", "edge", "road"] | None = None
    id: Annotated[str, Field(max_length=64)] = ""


class PublishBody(_Body):
    """Publish the draft; ``confirmed`` where somebody has seen the errors of this ``version``."""

    confirmed: bool = False
    version: Number | None = None

    @model_validator(mode="after")
    def _says_what_was_seen(self) -> PublishBody:
        if self.confirmed and self.version is None:
            raise ValueError("say which version's errors were seen.")
        return self


class RollBackBody(_Body):
    """Go back to an earlier version; ``base_version`` is the draft's that was looked at."""

    base_version: Number | None = None


class VersionBody(_Body):
    """A name for the draft as it is now."""

    name: Annotated[str, Field(min_length=1, max_length=80)]


class DestinationBody(_Body):
    """Where to lead the walker."""

    poi_id: Annotated[str, Field(min_length=1, max_length=64)]


class SayBody(_Body):
    """What the walker is told."""

    text: Annotated[str, Field(min_length=1, max_length=300)]


class AskColourBody(_Body):
    """Why somebody wants to see colour pictures; the walker hears it."""

    why: Annotated[str, Field(max_length=100)] = ""


class DaysBody(_Body):
    """For how many days things are kept."""

    days: Annotated[StrictInt, Field(ge=MIN_DAYS, le=MAX_DAYS)]


class RehearsalBody(_Body):
    """The way to rehearse, and how the walker is spoken to; None is the default of the settings."""

    start: Annotated[str, Field(min_length=1, max_length=64)]
    destination: Annotated[str, Field(min_length=1, max_length=64)]
    language: Language | None = None
    direction_style: DirectionStyle | None = None
    verbosity: Verbosity | None = None

    def cues(self) -> dict[str, str]:
        """Return what is chosen of the settings of the cues."""
        chosen = {"language": self.language, "direction_style": self.direction_style, "verbosity": self.verbosity}
        return {name: value for name, value in chosen.items() if value is not None}


SettingValues = Annotated[dict[str, StrictBool | StrictInt | StrictFloat | StrictStr], Field(max_length=200)]


class _ConfirmationBody(_Body):
    why: Annotated[str, Field(max_length=300), _PLAIN] = ""
    confirmed: bool = False
    """Somebody has confirmed a change of what people's safety hangs on."""
    override_reason: Annotated[str, Field(max_length=300), _PLAIN] = ""
    """Why that is changed though somebody is being led."""
    trial_s: Annotated[float, Field(ge=10.0, le=600.0, allow_inf_nan=False)] = TRIAL_S
    """How long it is tried out."""
    seen_revision: Number | None = None
    """What the device ran when somebody decided; refused where another one runs by now."""


class SettingsBody(_ConfirmationBody):
    """Settings to change, ``group.name`` → value, all of them or none."""

    changes: Annotated[SettingValues, Field(min_length=1)]


class BackToBody(_ConfirmationBody):
    """An earlier revision to run again."""

    revision: Annotated[int, Field(ge=1, le=MAX_NUMBER)]


class KeepBody(_Body):
    """Keep the revision that is tried out, or give it up."""

    revision: Annotated[int, Field(ge=1, le=MAX_NUMBER)]
    keep: bool = True


PresetName = Annotated[str, Field(min_length=1, max_length=200)]


class PresetNameBody(_Body):
    """Another name for a preset."""

    name: PresetName


class SavePresetBody(_Body):
    """Values to keep under a name; without any, those that the device runs."""

    name: PresetName
    device_id: Annotated[str, Field(max_length=120)] = ""
    values: SettingValues = {}


class PresetFileBody(_Body):
    """A preset as it was exported."""

    format: Literal["vbr-settings-preset"]
    version: Literal[1]
    name: PresetName
    values: Annotated[SettingValues, Field(min_length=1)]


class WhatIfBody(_Body):
    """A past walk, and the settings to judge by it; of its last seconds alone where ``last_s`` says so."""

    walk_id: Annotated[str, Field(min_length=1, max_length=200)]
    changes: Annotated[SettingValues, Field(min_length=1)]
    last_s: Annotated[float, Field(ge=10.0, le=86400.0, allow_inf_nan=False)] | None = None


class InviteBody(_Body):
    """A person to let in."""

    name: PersonName
    role: Role


class UserChangeBody(_Body):
    """Another role, or the account locked; None leaves it."""

    role: Role | None = None
    disabled: bool | None = None


class TokenBody(_Body):
    """The device that a token is for."""

    name: PersonName
