"""Parts of the untimed proofs that take about equally long; CI runs one of them a commit."""

from __future__ import annotations

import argparse
import re
from functools import cache
from zlib import crc32

# Processor time in s of the proofs of a file, or of one test where a file's tests run separately.
# Only the balance of the parts and of the workers depends on these measurements.
SECONDS: dict[str, float] = {}


def part(text: str) -> tuple[int, int]:
    """Parse ``k/n``, the number of a part and how many there are."""
    match = re.fullmatch(r"([0-9]+)/([0-9]+)", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a part of the proofs: write k/n with k from 1 to n, as in 1/4 to 4/4"
        )
    return int(match[1]), int(match[2])


@cache
def _largest(parts: int) -> dict[str, int]:
    """Return the part of each group of `SECONDS`: the longest first, to the shortest part."""
    totals = [0.0] * parts
    numbers = {}
    for group, seconds in sorted(SECONDS.items(), key=lambda item: (-item[1], item[0])):
        shortest = totals.index(min(totals))
        totals[shortest] += seconds
        numbers[group] = shortest + 1
    return numbers


def part_of(group: str, parts: int) -> int:
    """Return the number, from 1, of the part that runs a group of tests."""
    return _largest(parts).get(group) or crc32(group.encode()) % parts + 1
