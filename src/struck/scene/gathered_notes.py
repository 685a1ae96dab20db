"""Notes of several bodies, gathered: equal ones become one line that names the bodies."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

QUOTED_FORM = "'{}'"  # form of names within a sentence
_MAX_NAMES = 6  # in one line; more are counted
_MIN_RUN = 3  # of numbered names in a row that are written "c0 to c3"
_NUMBERED_NAME = re.compile(r"(.*?)(\d+)")


def gather_notes(notes: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Return notes of bodies, given as (name, text), as lines "names: text", equal texts in one.

    In a line of several bodies "its" becomes "their", and "it is" "they are".
    """
    bodies: dict[str, list[str]] = {}
    for name, text in notes:
        names = bodies.setdefault(text, [])
        if name not in names:
            names.append(name)
    return tuple(
        f"{list_names(names)}: {text if len(names) == 1 else with_plural(text)}"
        for text, names in bodies.items()
    )


def with_plural(text: str) -> str:
    """Return a text about one body, its pronouns in the plural."""
    return re.sub(r"\bit is\b", "they are", re.sub(r"\bits\b", "their", text))


def list_names(names: Sequence[str], form: str = "{}") -> str:
    """Return names as words: "a, b and c", numbered ones as "c0 to c3", more than six counted.

    `form` is how a single name is written, such as `QUOTED_FORM`.
    """
    parts: list[str] = []
    counts: list[int] = []
    for run in _runs(names):
        if len(run) >= _MIN_RUN:
            parts.append(f"{form.format(run[0])} to {form.format(run[-1])}")
            counts.append(len(run))
        else:
            parts += [form.format(name) for name in run]
            counts += [1] * len(run)
    if len(parts) > _MAX_NAMES:
        others = sum(counts[_MAX_NAMES - 1 :])
        parts = [*parts[: _MAX_NAMES - 1], f"{others} others"]
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last


def _runs(names: Sequence[str]) -> list[list[str]]:
    """Return the names, numbered ones sorted and grouped where their numbers follow each other."""
    stems: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        match = _NUMBERED_NAME.fullmatch(name)
        stem, number = (match[1], int(match[2])) if match else (f"{name}\0", 0)
        stems.setdefault(stem, []).append((number, name))
    runs: list[list[str]] = []
    for entries in stems.values():
        last_number = -2
        for number, name in sorted(entries):
            if number != last_number + 1:
                runs.append([])
            runs[-1].append(name)
            last_number = number
    return runs
