"""Named sets of values for settings: built in, saved from a device, exported and imported as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from sqlalchemy import select
from sqlalchemy.orm import Session

from console.errors import BadRequestError, ConflictError, NotFoundError
from console.store import Store
from console.tables import SettingsPresetRow
from navcore.settings import Settings, SettingValue, setting_specs

MAX_NAME_LENGTH = 60
MAX_PRESETS_COUNT = 200
FILE_FORMAT, FILE_VERSION = "vbr-settings-preset", 1


@dataclass(frozen=True, slots=True)
class Preset:
    """A named set of values; settings that are not in it stay as they are."""

    name: str
    values: Mapping[str, SettingValue]
    about: str
    author: str = ""
    """Who saved it; empty where it is built in."""
    at_s: float = 0.0
    """Unix time."""

    @property
    def built_in(self) -> bool:
        """It belongs to the program: neither renamed nor deleted."""
        return not self.author

    def as_file(self) -> dict[str, object]:
        """Return it as it is exported."""
        return {"format": FILE_FORMAT, "version": FILE_VERSION, "name": self.name, "values": dict(self.values)}


def _built_in() -> Mapping[str, Preset]:
    paper = {spec.key: spec.paper for spec in setting_specs() if spec.paper is not None}
    presets = (
        Preset("Defaults", Settings().values(), "Every setting as the program comes."),
        Preset("Paper", paper, "The values that the paper names, and its guidance policy; all else stays as it is."),
    )
    return MappingProxyType({preset.name.casefold(): preset for preset in presets})


BUILT_IN = _built_in()


class Presets:
    """The presets of a console. All methods may be called from any thread."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def all(self) -> tuple[Preset, ...]:
        """Return every preset: those that are built in, then the others by name."""
        with self._store.reading() as session:
            rows = session.scalars(select(SettingsPresetRow).order_by(SettingsPresetRow.name_key))
            return (*BUILT_IN.values(), *map(_as_preset, rows))

    def named(self, name: str) -> Preset:
        """Return a preset. Raises NotFoundError."""
        built_in = BUILT_IN.get(name.casefold())
        if built_in is not None:
            return built_in
        with self._store.reading() as session:
            return _as_preset(_row(session, name))

    def save(self, name: str, values: Mapping[str, SettingValue], by: str) -> Preset:
        """Keep values under a new name.

        Raises SettingError where they are out of range or order, BadRequestError for a name that nobody could read,
        ConflictError where the name is taken or there are too many.
        """
        shown = _checked_name(name)
        if not values:
            raise BadRequestError("This preset holds no values: save one from a device.")
        Settings().changed(values)
        with self._store.writing() as session:
            self._refuse_taken(session, shown)
            if len(session.scalars(select(SettingsPresetRow.name_key)).all()) >= MAX_PRESETS_COUNT:
                raise ConflictError(f"There are {MAX_PRESETS_COUNT} presets already: delete one first.")
            row = SettingsPresetRow(
                name_key=shown.casefold(), name=shown, author=by, at_s=self._store.wall_s(),
                values_json=json.dumps(dict(values)),
            )  # fmt: skip
            session.add(row)
            self._store.add_audit(session, by, "preset_saved", shown)
        return _as_preset(row)

    def rename(self, name: str, to: str, by: str) -> Preset:
        """Give a preset another name. Raises NotFoundError, BadRequestError or ConflictError."""
        shown = _checked_name(to)
        with self._store.writing() as session:
            row = _row(session, name)
            if shown.casefold() != row.name_key:
                self._refuse_taken(session, shown)
            self._store.add_audit(session, by, "preset_renamed", f"{row.name}: {shown}")
            row.name_key, row.name = shown.casefold(), shown
        return _as_preset(row)

    def delete(self, name: str, by: str) -> None:
        """Delete a preset. Raises NotFoundError."""
        with self._store.writing() as session:
            row = _row(session, name)
            session.delete(row)
            self._store.add_audit(session, by, "preset_deleted", f"{row.name}: {row.values_json}")

    def _refuse_taken(self, session: Session, name: str) -> None:
        if name.casefold() in BUILT_IN or session.get(SettingsPresetRow, name.casefold()) is not None:
            raise ConflictError(f"There is a preset {name!r} already: choose another name.")


def _row(session: Session, name: str) -> SettingsPresetRow:
    if name.casefold() in BUILT_IN:
        raise BadRequestError(f"The preset {name!r} belongs to the program: save your own under another name.")
    row = session.get(SettingsPresetRow, name.casefold())
    if row is None:
        raise NotFoundError(f"There is no preset {name!r}: choose one from the list.")
    return row


def _checked_name(name: str) -> str:
    shown = " ".join(name.split())
    if not shown or len(shown) > MAX_NAME_LENGTH or not shown.isprintable() or "/" in shown:
        raise BadRequestError(f"A preset's name has 1 to {MAX_NAME_LENGTH} characters that can be read, and no '/'.")
    return shown


def _as_preset(row: SettingsPresetRow) -> Preset:
    return Preset(row.name, json.loads(row.values_json), "", row.author, row.at_s)
