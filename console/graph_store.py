"""The log of edits in the database."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
from sqlalchemy import Select, select
from sqlalchemy.exc import IntegrityError

from console.edit_words import sentence_of
from console.errors import ConflictError
from console.graph_log import NAME_TAKEN, LogEntry, Publication, PublishedVersion, VersionName
from console.store import Store
from console.tables import GraphEntryRow, PublicationRow, SiteRow, VersionNameRow
from navcore.errors import InputError
from navcore.misfit import words_of
from navcore.planning.poi_graph import PoiGraph


def graph_key(site_id: str, map_sha256: str) -> str:
    """Return under which id the edits of a site are stored.

    Places are coordinates of one map: a map that was built anew is another site, and starts from its own graph.
    """
    return f"{site_id}@{map_sha256[:16]}"


class StoredGraphLog:
    """The edits and publications of one site: a :class:`console.graph_log.GraphLog`."""

    def __init__(self, store: Store, site_id: str, site_name: str) -> None:
        self._store = store
        self._site_id = site_id
        with store.writing() as session:
            if session.get(SiteRow, site_id) is None:
                session.add(SiteRow(site_id=site_id, name=site_name, first_opened_at_s=store.wall_s()))

    def entries(self, up_to: int | None = None) -> Iterable[LogEntry]:
        """Every entry, or those up to a version, in order. Raises InputError where one cannot be read."""
        rows = select(GraphEntryRow).where(GraphEntryRow.site_id == self._site_id).order_by(GraphEntryRow.version)
        if up_to is not None:
            rows = rows.where(GraphEntryRow.version <= up_to)
        return self._read(rows)

    def newest(self, count: int) -> Iterable[LogEntry]:
        """The latest entries, newest first. Raises InputError where one cannot be read."""
        rows = select(GraphEntryRow).where(GraphEntryRow.site_id == self._site_id)
        return self._read(rows.order_by(GraphEntryRow.version.desc()).limit(count))

    def _read(self, rows: Select[GraphEntryRow]) -> list[LogEntry]:
        with self._store.reading() as session:
            return [self._decode(row.version, row.entry_json) for row in session.scalars(rows)]

    def published(self) -> Publication | None:
        """The latest publication."""
        rows = select(PublicationRow).where(PublicationRow.site_id == self._site_id)
        with self._store.reading() as session:
            row = session.scalar(rows.order_by(PublicationRow.version.desc()).limit(1))
        if row is None:
            return None
        return Publication(msgspec.json.decode(row.graph_json, type=PoiGraph), row.author, row.at_s)

    def publications(self) -> Iterable[PublishedVersion]:
        """Every publication, in the order of versions."""
        columns = select(PublicationRow.version, PublicationRow.author, PublicationRow.at_s)
        rows = columns.where(PublicationRow.site_id == self._site_id).order_by(PublicationRow.version)
        with self._store.reading() as session:
            return [PublishedVersion(version, author, at_s) for version, author, at_s in session.execute(rows)]

    def names(self) -> Iterable[VersionName]:
        """Every name that was given to a version, oldest first."""
        rows = select(VersionNameRow).where(VersionNameRow.site_id == self._site_id).order_by(VersionNameRow.at_s)
        with self._store.reading() as session:
            return [VersionName(row.version, row.name, row.author, row.at_s) for row in session.scalars(rows)]

    def append(self, entry: LogEntry) -> None:
        """Store an entry durably, with its line in the audit log. Raises ConflictError where its version exists."""
        text = msgspec.json.encode(entry).decode()
        row = GraphEntryRow(
            site_id=self._site_id, version=entry.version, author=entry.author, at_s=entry.at_s, entry_json=text
        )
        try:
            with self._store.writing() as session:
                session.add(row)
                self._store.add_audit(
                    session, entry.author, f"graph_{entry.kind}", f"{sentence_of(entry)} (version {entry.version})"
                )
        except IntegrityError as error:
            raise ConflictError(
                "Another console edits the same site and database: stop one of the two, then try again."
            ) from error

    def add_publication(self, publication: Publication) -> None:
        """Store a publication durably."""
        graph = publication.graph
        with self._store.writing() as session:
            session.add(
                PublicationRow(
                    site_id=self._site_id,
                    version=graph.version,
                    author=publication.author,
                    at_s=publication.at_s,
                    graph_json=msgspec.json.encode(graph).decode(),
                )
            )
            self._store.add_audit(session, publication.author, "graph_publish", f"version {graph.version}")

    def add_name(self, name: VersionName) -> None:
        """Store a name durably. Raises ConflictError where it is taken."""
        row = VersionNameRow(
            site_id=self._site_id, name=name.name, version=name.version, author=name.author, at_s=name.at_s
        )
        try:
            with self._store.writing() as session:
                session.add(row)
                self._store.add_audit(session, name.author, "graph_name", f"version {name.version}: {name.name}")
        except IntegrityError as error:
            raise ConflictError(NAME_TAKEN) from error

    @staticmethod
    def _decode(version: int, text: str) -> LogEntry:
        try:
            return msgspec.json.decode(text, type=LogEntry)
        except msgspec.MsgspecError as error:
            raise InputError(
                f"Version {version} of the PoI-graph cannot be read from the database ({words_of(error)}): restore a"
                " backup."
            ) from error
