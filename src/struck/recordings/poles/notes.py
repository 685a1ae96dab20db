"""What a person should know of many takes, each thing once."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from struck.recordings.onsets import Hit
from struck.recordings.takes.checks import findings
from struck.recordings.takes.take import Take

_NUMBER = re.compile(r"-?\d+(\.\d+)?")


def notes_on(takes: Sequence[Take], hits: Iterable[Sequence[Hit]]) -> Iterator[str]:
    """Yield findings on takes: of those that several share, the first, and how many more.

    Files are named without their folders, which are nobody's business.
    """
    alike: dict[str, list[str]] = {}
    for take, own in zip(takes, hits, strict=True):
        for note in findings(take, own):
            kind = _NUMBER.sub("#", note.replace(take.name, ""))
            alike.setdefault(kind, []).append(note.replace(take.name, Path(take.name).name))
    for notes in alike.values():
        more = len(notes) - 1
        yield f"{notes[0]}; so {more} more take{'s' if more > 1 else ''}" if more else notes[0]
