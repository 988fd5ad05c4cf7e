"""The tables of the console's database. Times are Unix seconds; secrets are kept as hashes only."""

from __future__ import annotations

from sqlalchemy import ForeignKey, Index, Text, UniqueConstraint
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

SCHEMA_VERSION = 5
"""2 added the names of versions. 3 added what the monitor keeps. 4 added when devices were heard of. 5 added the
tokens that are void."""


class Base(DeclarativeBase):
    """Base of all tables."""


class SchemaRow(Base):
    """The version of these tables; one row."""

    __tablename__ = "schema_info"
    version: Mapped[int] = mapped_column(primary_key=True)


class UserRow(Base):
    """A person who may sign in."""

    __tablename__ = "users"
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    name_key: Mapped[str] = mapped_column(unique=True)
    """The name as it is compared: without regard to case and spacing."""
    password_hash: Mapped[str]
    """argon2id; empty until the person has chosen a password."""
    role: Mapped[str]
    created_at_s: Mapped[float]
    disabled_at_s: Mapped[float | None]


class SessionRow(Base):
    """A signed-in browser."""

    __tablename__ = "sessions"
    token_hash: Mapped[str] = mapped_column(primary_key=True)
    user_id: Mapped[int] = mapped_column(ForeignKey("users.id"), index=True)
    created_at_s: Mapped[float]
    last_seen_at_s: Mapped[float]


class OneTimeLinkRow(Base):
    """A link that lets one person choose a password, once."""

    __tablename__ = "one_time_links"
    token_hash: Mapped[str] = mapped_column(primary_key=True)
    user_id: Mapped[int | None] = mapped_column(ForeignKey("users.id"))
    """Whose password it sets; None makes a new admin."""
    created_at_s: Mapped[float]
    expires_at_s: Mapped[float]
    used_at_s: Mapped[float | None]


class DeviceTokenRow(Base):
    """What a device signs in with."""

    __tablename__ = "device_tokens"
    name: Mapped[str] = mapped_column(primary_key=True)
    token_hash: Mapped[str] = mapped_column(unique=True)
    created_by: Mapped[str]
    created_at_s: Mapped[float]
    last_seen_at_s: Mapped[float | None]
    revoked_at_s: Mapped[float | None]


class VoidTokenRow(Base):
    """A device token that a newer one has taken the place of: no file brings it back."""

    __tablename__ = "void_device_tokens"
    token_hash: Mapped[str] = mapped_column(primary_key=True)


class DeviceRow(Base):
    """A device that has called, and the token's name that it belongs to: no other token may speak for it."""

    __tablename__ = "devices"
    device_id: Mapped[str] = mapped_column(primary_key=True)
    token_name: Mapped[str] = mapped_column(ForeignKey("device_tokens.name"))


class SiteRow(Base):
    """A site that this console has opened."""

    __tablename__ = "sites"
    site_id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    first_opened_at_s: Mapped[float]


class GraphEntryRow(Base):
    """One change of a site's draft graph."""

    __tablename__ = "graph_entries"
    site_id: Mapped[str] = mapped_column(ForeignKey("sites.site_id"), primary_key=True)
    version: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    author: Mapped[str]
    at_s: Mapped[float]
    entry_json: Mapped[str] = mapped_column(Text)
    """The whole entry: :class:`console.graph_log.LogEntry`."""


class PublicationRow(Base):
    """A graph as it was published."""

    __tablename__ = "publications"
    site_id: Mapped[str] = mapped_column(ForeignKey("sites.site_id"), primary_key=True)
    version: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    author: Mapped[str]
    at_s: Mapped[float]
    graph_json: Mapped[str] = mapped_column(Text)


class VersionNameRow(Base):
    """A version of a site's draft that somebody gave a name."""

    __tablename__ = "version_names"
    site_id: Mapped[str] = mapped_column(ForeignKey("sites.site_id"), primary_key=True)
    name: Mapped[str] = mapped_column(primary_key=True)
    version: Mapped[int]
    author: Mapped[str]
    at_s: Mapped[float]


class EventRow(Base):
    """An event of a device, stored before it is confirmed."""

    __tablename__ = "device_events"
    __table_args__ = (UniqueConstraint("device_id", "sequence"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    device_id: Mapped[str] = mapped_column(ForeignKey("devices.device_id"))
    sequence: Mapped[int]
    stamp_s: Mapped[float]
    arrived_at_s: Mapped[float]
    kind: Mapped[str]
    text: Mapped[str]


class SettingsRevisionRow(Base):
    """Settings that somebody asked a device to run: who, when, from, to, why, and what the device said."""

    __tablename__ = "settings_revisions"
    revision: Mapped[int] = mapped_column(primary_key=True)
    device_id: Mapped[str] = mapped_column(ForeignKey("devices.device_id"), index=True)
    author: Mapped[str]
    at_s: Mapped[float]
    why: Mapped[str]
    changes_json: Mapped[str] = mapped_column(Text)
    """``{"group.name": [from, to]}``."""
    values_json: Mapped[str] = mapped_column(Text)
    state: Mapped[str]
    """sent, trying, running, refused or reverted: see :mod:`console.settings_store`."""
    refusal: Mapped[str]


class SettingsTrialRow(Base):
    """Settings that were to run for a while only, unless somebody keeps them."""

    __tablename__ = "settings_trials"
    revision: Mapped[int] = mapped_column(
        ForeignKey("settings_revisions.revision"), primary_key=True, autoincrement=False
    )
    revert_after_s: Mapped[float]
    override_reason: Mapped[str]
    """Why they were changed though somebody was being led; empty where nobody was."""


class SettingsPresetRow(Base):
    """A named set of values."""

    __tablename__ = "settings_presets"
    name_key: Mapped[str] = mapped_column(primary_key=True)
    """The name as it is compared: without regard to case."""
    name: Mapped[str]
    author: Mapped[str]
    at_s: Mapped[float]
    values_json: Mapped[str] = mapped_column(Text)
    """``{"group.name": value}``."""


class AuditRow(Base):
    """Something that somebody did."""

    __tablename__ = "audit"
    __table_args__ = (Index("audit_by_time", "at_s"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    at_s: Mapped[float]
    who: Mapped[str]
    action: Mapped[str]
    detail: Mapped[str]


class AlertRow(Base):
    """An alert of a device, from when it was raised until it is done with."""

    __tablename__ = "alerts"
    __table_args__ = (Index("alerts_by_time", "raised_at_s"),)
    alert_id: Mapped[str] = mapped_column(primary_key=True)
    device_id: Mapped[str] = mapped_column(index=True)
    device_name: Mapped[str]
    kind: Mapped[str]
    priority: Mapped[int]
    sentence: Mapped[str] = mapped_column(Text)
    raised_at_s: Mapped[float]
    is_active: Mapped[bool]
    times: Mapped[int]
    """How often its condition has come before the alert was done with."""
    returned_at_s: Mapped[float | None]
    acknowledged_at_s: Mapped[float | None]
    acknowledged_by: Mapped[str]
    note: Mapped[str] = mapped_column(Text)
    shelved_until_s: Mapped[float | None]
    shelved_by: Mapped[str]
    shelf_reason: Mapped[str] = mapped_column(Text)
    incident_id: Mapped[str]
    closed_at_s: Mapped[float | None] = mapped_column(index=True)


class AlertStepRow(Base):
    """Something that happened to an alert."""

    __tablename__ = "alert_steps"
    id: Mapped[int] = mapped_column(primary_key=True)
    alert_id: Mapped[str] = mapped_column(index=True)
    at_s: Mapped[float]
    what: Mapped[str]
    """A value of :class:`console.alerts.lifecycle.Change`."""
    who: Mapped[str]
    """Empty where nobody did it."""
    detail: Mapped[str] = mapped_column(Text)


class LedRow(Base):
    """A device that leads somebody: a console that is started anew knows that it must hear of it."""

    __tablename__ = "devices_leading"
    device_id: Mapped[str] = mapped_column(primary_key=True)
    device_name: Mapped[str]
    since_s: Mapped[float]


class HeardRow(Base):
    """When a device that leads somebody was heard of last."""

    __tablename__ = "devices_heard"
    device_id: Mapped[str] = mapped_column(primary_key=True)
    heard_at_s: Mapped[float]
    event_sequence: Mapped[int]
    """Its newest event then."""


class AccessRow(Base):
    """That somebody has watched a walker, or looked at what is kept of them."""

    __tablename__ = "accesses"
    __table_args__ = (Index("accesses_by_device", "device_id", "ended_at_s"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    who: Mapped[str]
    what: Mapped[str]
    """A :data:`console.access.What`."""
    device_id: Mapped[str]
    """Empty for what concerns every walker."""
    detail: Mapped[str]
    about_s: Mapped[float | None]
    """When the walk or incident was that was looked at."""
    began_at_s: Mapped[float]
    ended_at_s: Mapped[float]


class KeptValueRow(Base):
    """A value that the console itself remembers, as JSON."""

    __tablename__ = "kept_values"
    name: Mapped[str] = mapped_column(primary_key=True)
    value_json: Mapped[str] = mapped_column(Text)
