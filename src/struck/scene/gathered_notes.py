"""Notes of several bodies, gathered: equal ones become one line that names the bodies."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

QUOTED = "'{}'"  # form of names within a sentence
_MOST_NAMES = 6  # in one line; more are counted
_SHORTEST_RUN = 3  # of numbered names in a row that are written "c0 to c3"
_NUMBERED = re.compile(r"(.*?)(\d+)")


def gathered(notes: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Return notes of bodies, given as (name, text), as lines "names: text", equal texts in one.

    In a line of several bodies "its" becomes "their", and "it is" "they are".
    """
    bodies: dict[str, list[str]] = {}
    for name, text in notes:
        names = bodies.setdefault(text, [])
        if name not in names:
            names.append(name)
    return tuple(
        f"{listed(names)}: {text if len(names) == 1 else of_several(text)}"
        for text, names in bodies.items()
    )


def of_several(text: str) -> str:
    """Return a text about one body, its pronouns in the plural."""
    return re.sub(r"\bit is\b", "they are", re.sub(r"\bits\b", "their", text))


def listed(names: Sequence[str], form: str = "{}") -> str:
    """Return names as words: "a, b and c", numbered ones as "c0 to c3", more than six counted.

    `form` is how a single name is written, such as `QUOTED`.
    """
    parts: list[str] = []
    counts: list[int] = []
    for run in _runs(names):
        if len(run) >= _SHORTEST_RUN:
            parts.append(f"{form.format(run[0])} to {form.format(run[-1])}")
            counts.append(len(run))
        else:
            parts += [form.format(name) for name in run]
            counts += [1] * len(run)
    if len(parts) > _MOST_NAMES:
        others = sum(counts[_MOST_NAMES - 1 :])
        parts = [*parts[: _MOST_NAMES - 1], f"{others} others"]
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last


def _runs(names: Sequence[str]) -> list[list[str]]:
    """Return the names, numbered ones sorted and grouped where their numbers follow each other."""
    stems: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        match = _NUMBERED.fullmatch(name)
        stem, number = (match[1], int(match[2])) if match else (f"{name}\0", 0)
        stems.setdefault(stem, []).append((number, name))
    runs: list[list[str]] = []
    for numbered in stems.values():
        before = -2
        for number, name in sorted(numbered):
            if number != before + 1:
                runs.append([])
            runs[-1].append(name)
            before = number
    return runs
