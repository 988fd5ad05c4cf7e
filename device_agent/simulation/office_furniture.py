"""Where the furniture of the office floor stands: at least 0.6 m from the lines on which people walk."""

from __future__ import annotations

from device_agent.simulation import furniture as fit
from device_agent.simulation.shapes import Piece, together

_MOVABLE = frozenset(
    {"desk", "chair", "sofa", "table", "stool", "shelf", "cabinet", "bench", "plant", "vending machine", "copier"}
)


def office_furniture() -> list[Piece]:
    """Return all of it, room by room."""
    return [_open_doors(), *_hall(), *_wash_room(), *_bar(), *_lounge(), *_rooms(), *_corridors()]


def is_movable(piece: Piece) -> bool:
    """Tell whether people move such a thing now and then."""
    return bool(piece.solids) and all(solid.name in _MOVABLE for solid in piece.solids)


def _hall() -> list[Piece]:
    return [
        fit.counter(2.6, "wood/#7a4f2e:reception").moved(17.9, 1.9, -90.0),
        fit.monitor("reception").moved(17.9, 2.4, -90.0, 1.1),
        fit.pillar("concrete/#b9b5aa:west").moved(12.9, 3.6),
        fit.pillar("concrete/#b9b5aa:east").moved(17.1, 4.0),
        fit.sofa("#355e62", 1.8).moved(11.55, 1.9, 90.0),
        fit.low_table("hall").moved(12.6, 1.9, 90.0),
        fit.plant("hall-1").moved(11.45, 0.6),
        fit.plant("hall-2", 1.7).moved(18.5, 0.6),
        fit.vending_machine("hall").moved(18.55, 4.25, -90.0),
        fit.plant("hall-3", 1.2).moved(11.5, 4.2),
    ]


def _wash_room() -> list[Piece]:
    cubicles = [fit.cubicle("#6f8f96", f"{k + 1}").moved(1.85 + 1.0 * k, 11.42) for k in range(3)]
    return [
        *cubicles,
        fit.wash_basins(3, "wash").moved(3.2, 8.12, 180.0),
        fit.cabinet(0.6, 0.9).moved(1.5, 9.0, 90.0),
    ]


def _bar() -> list[Piece]:
    return [
        fit.bottle_wall("bar", 3.2).moved(29.55, 10.9, -90.0),
        fit.counter(3.2, "brick/#6d4a3a:bar").moved(28.3, 10.9, -90.0),
        *(fit.stool("#7d2f2a", 0.75).moved(27.75, y) for y in (10.9, 11.8)),
        fit.round_table(3, "#8a3b2f").moved(25.6, 8.25),
        fit.round_table(3, "#31586b").moved(28.2, 8.2),
        fit.round_table(2, "#8a3b2f").moved(25.6, 11.9),
        fit.plant("bar").moved(24.65, 12.4),
    ]


def _lounge() -> list[Piece]:
    return [
        fit.sofa("#8c4a3c").moved(16.3, 18.9),
        fit.sofa("#3f5b78", 1.8).moved(14.6, 17.2, 90.0),
        fit.low_table("lounge").moved(16.3, 17.6),
        fit.sofa("#556b4a", 1.8).moved(21.4, 17.6, -90.0),
        fit.shelf("lounge", 1.6).moved(19.4, 19.55),
        fit.plant("lounge-1", 1.8).moved(21.5, 19.3),
        fit.plant("lounge-2", 1.4).moved(14.4, 19.4),
        fit.shelf("lounge-2", 1.2, 1.3).moved(15.4, 15.5, 180.0),
        fit.low_table("lounge-east").moved(20.5, 17.6, 90.0),
    ]


def _rooms() -> list[Piece]:
    return [
        fit.desk("3311-a").moved(5.4, 18.9),
        fit.chair().moved(5.4, 18.2, 180.0),
        fit.desk("3311-b").moved(8.0, 19.1),
        fit.chair("#7a3c3c").moved(8.0, 18.4, 180.0),
        fit.shelf("3311", 1.2).moved(8.95, 16.6, -90.0),
        fit.plant("3311", 1.3).moved(4.9, 16.0),
        fit.copier("3311").moved(4.95, 17.3, 90.0),
        fit.desk("3308-a").moved(10.1, 19.2),
        fit.chair("#3c7a5a").moved(10.1, 18.45, 180.0),
        fit.desk("3308-b").moved(12.9, 18.6, -90.0),
        fit.chair("#3c5a7a").moved(12.1, 18.6, 90.0),
        fit.shelf("3308", 1.4).moved(13.72, 16.6, -90.0),
        fit.cabinet().moved(9.5, 16.2, 90.0),
        fit.desk("office-a").moved(9.6, 8.4),
        fit.chair().moved(9.6, 9.2),
        fit.desk("office-b").moved(12.0, 8.5),
        fit.chair("#7a6a3c").moved(12.0, 9.3),
        fit.shelf("office-a", 1.4).moved(9.6, 12.5),
        fit.shelf("office-b", 1.4).moved(11.3, 12.5),
        fit.plant("office", 1.6).moved(13.2, 12.2),
    ]


def _corridors() -> list[Piece]:
    return [
        fit.plant("c-1", 1.5).moved(6.15, 5.15),
        fit.plant("c-2", 1.6).moved(23.85, 5.15),
        fit.plant("c-3", 1.4).moved(23.8, 14.75),
        fit.bench().moved(9.2, 5.08, 180.0),
        fit.cabinet(0.9, 0.9).moved(20.6, 5.05, 180.0),
        fit.cabinet(1.2, 1.0).moved(23.94, 8.1, -90.0),
        fit.shelf("north", 1.0, 1.2).moved(16.9, 14.95),
        fit.cabinet(0.9, 1.0).moved(6.06, 7.4, 90.0),
        fit.pillar("concrete/#a9a69c:k", 0.15).moved(16.0, 12.98),
    ]


def _open_doors() -> Piece:
    """Door leaves that stand open, flat against the wall inside the room."""
    return together(
        fit.door_leaf("#9a6b3f").moved(5.12, 15.3, 0.0),
        fit.door_leaf("#7d8a94").moved(11.72, 15.3, 0.0),
        fit.door_leaf("#7d8a94").moved(5.7, 10.72, 90.0),
    )
