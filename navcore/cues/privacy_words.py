"""In words: who watches, and who has looked at what is kept of a walker. Pure.

Times of day are those of the console's clock, which is on the wall of the same building.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, date, datetime, timedelta

from navcore.cues.texts import TEXTS, Language
from navcore.wire import Access

MAX_NAMED_COUNT = 3
"""More people than these are counted, not named."""
MAX_LINES_COUNT = 6
_WEEKDAYS: dict[Language, tuple[str, ...]] = {
    "en": ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday"),
    "zh": ("星期一", "星期二", "星期三", "星期四", "星期五", "星期六", "星期日"),
}
_MONTHS = (
    "January", "February", "March", "April", "May", "June", "July", "August", "September", "October", "November",
    "December",
)  # fmt: skip

_OF_SOMETHING = frozenset({"past_walk", "incident", "export"})
"""What is looked at is one of several: each has its day, and several are counted."""


def names_text(names: Sequence[str], language: Language) -> str:
    """Return at least one name as people list them: "Anna", "Anna and Ben", "Anna, Ben, Cem and 2 others"."""
    texts, comma = TEXTS[language], "、" if language == "zh" else ", "
    if len(names) == 1:
        return names[0]
    if len(names) <= MAX_NAMED_COUNT:
        return texts["names_and"].format(before=comma.join(names[:-1]), last=names[-1])
    named = names[: MAX_NAMED_COUNT - 1]
    return texts["names_others"].format(before=comma.join(named), count=len(names) - len(named))


def watching_text(key: str, names: Sequence[str], language: Language) -> str:
    """Return a sentence on one or several people; ``key`` is ``watch``, ``watch_also`` or ``watch_left``."""
    number = "one" if len(names) == 1 else "many"
    return TEXTS[language][f"{key}_{number}"].format(names=names_text(names, language))


def accesses_text(entries: Iterable[Access], now_s: float, utc_offset_s: float, language: Language) -> str:
    """Return who has watched, and looked at what, the latest last.

    Args:
        entries: what is known of it.
        now_s: the present time (Unix time).
        utc_offset_s: what the clocks on the wall show more than UTC.
        language: that of the words.
    """
    texts = TEXTS[language]
    groups: dict[tuple[str, str], list[Access]] = {}
    for entry in entries:
        groups.setdefault((entry.who, entry.what), []).append(entry)
    latest = sorted(groups.values(), key=lambda group: max(entry.ended_s for entry in group))
    told, left_out = latest[-MAX_LINES_COUNT:], len(latest[:-MAX_LINES_COUNT])
    if not told:
        return texts["access_none"]
    today = _wall(now_s, utc_offset_s).date()
    since = min(_wall(entry.began_s, utc_offset_s) for group in told for entry in group)
    lines = [texts["access_since"].format(day=_day_text(since.date(), today, language))]
    lines += [_line(group, today, utc_offset_s, language) for group in told]
    lines += [texts["access_more"].format(count=left_out)] if left_out else []
    return ("" if language == "zh" else " ").join(lines)


def _line(group: list[Access], today: date, utc_offset_s: float, language: Language) -> str:
    texts, last = TEXTS[language], max(group, key=lambda entry: entry.ended_s)
    ended = _wall(last.ended_s, utc_offset_s)
    when = texts["access_when"].format(day=_day_text(ended.date(), today, language), clock=f"{ended.hour}:{ended:%M}")
    if last.what in _OF_SOMETHING and (count := len({entry.about_s for entry in group})) > 1:
        return texts[f"access_{last.what}_many"].format(name=last.who, count=count, when=when)
    if last.about_s is not None and last.what in _OF_SOMETHING:
        day = _day_text(_wall(last.about_s, utc_offset_s).date(), today, language)
        return texts[f"access_{last.what}_of"].format(name=last.who, day=day)
    if last.what == "watch" and len(group) > 1:
        return texts["access_watch_times"].format(name=last.who, count=len(group), when=when)
    return texts[f"access_{last.what}"].format(name=last.who, when=when)


def _wall(unix_s: float, utc_offset_s: float) -> datetime:
    """Return what the clocks on the wall show; what lies beyond every calendar becomes its first day."""
    try:
        return datetime.fromtimestamp(unix_s + utc_offset_s, UTC)
    except (ValueError, OverflowError, OSError):
        return datetime.fromtimestamp(0, UTC)


def _day_text(day: date, today: date, language: Language) -> str:
    texts, ago = TEXTS[language], today - day
    if ago == timedelta(0):
        return texts["day_today"]
    if ago == timedelta(1):
        return texts["day_yesterday"]
    if timedelta(0) < ago < timedelta(7):
        return _WEEKDAYS[language][day.weekday()]
    return f"{day.month}月{day.day}日" if language == "zh" else f"{_MONTHS[day.month - 1]} {day.day}"
