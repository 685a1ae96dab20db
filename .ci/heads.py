"""Report names whose last word is no noun, and functions that begin with no verb, room by room.

A variable called `found` or `likely` does not say what it holds. Parts of speech are those of
Brill's lexicon, which the package textblob carries::

    python .ci/heads.py           # hits by room, compared with .ci/heads.json
    python .ci/heads.py --list    # each name, with its file and line
    python .ci/heads.py --write   # record the present counts as the baseline

It fails if a room has more such names per hundred than the baseline says.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from functools import cache
from importlib import resources
from pathlib import Path

from plain import Text, python_texts, words

BASELINE = Path(__file__).with_name("heads.json")
TOLERANCE = 0.05  # names per hundred, of a rounded baseline
# Words that the lexicon takes for verbs or adjectives first, and that are nouns of this field or
# name a variable well by themselves.
NOUNS = {
    *("faces", "face", "key", "keys", "take", "takes", "force", "forces", "pose", "poses", "taps"),
    *("tap", "orders", "order", "rule", "rules", "content", "contents", "transform", "offset"),
    *("derivative", "residual", "prior", "mean", "dim", "err", "out", "prod", "diagonal"),
    *(
        "constant",
        "uniform",
        "edges",
        "sides",
        "strikes",
        "strike",
        "hit",
        "hits",
        "blows",
        "rolls",
    ),
    *("scrapes", "plucks", "holds", "sounds", "notes", "levels", "samples", "rates", "modes"),
    *("shapes", "stretch", "cut", "cuts", "gain", "gains", "drive", "drives", "scale", "scales"),
    *(
        "width",
        "sweep",
        "sweeps",
        "fit",
        "fits",
        "load",
        "loads",
        "rise",
        "fall",
        "decay",
        "decays",
    ),
    *("row", "rows", "return", "max", "min", "real", "imag", "valid", "flat", "dense", "sparse"),
    *("index", "active", "empty", "raw", "input", "output", "default", "random", "linear", "start"),
    *("end", "first", "last", "next", "previous", "low", "high", "lower", "upper", "left", "right"),
    *("front", "back", "top", "local", "global", "old", "new", "current", "abs", "axis", "add"),
}
HELD = {"variable", "parameter", "attribute", "constant"}


@cache
def tags() -> dict[str, str]:
    """Return the most frequent part of speech of each word."""
    text = (resources.files("textblob") / "en/en-lexicon.txt").read_text(encoding="utf-8")
    entries = (line.split() for line in text.splitlines() if not line.startswith(";"))
    parts: dict[str, str] = {}
    for entry in entries:
        if len(entry) > 1:
            parts.setdefault(entry[0].lower(), entry[1])
    return parts


def is_unclear(name: Text) -> bool:
    """Return whether the decisive word of a name has the wrong part of speech.

    It is the last word of a variable, which has to be a noun unless the variable is a mask
    (`is_...`), and the first word of a function, which has to be a verb, or a noun if it is the
    only one. Words that the lexicon lacks count as terms of the field.
    """
    parts = words(name.text)
    if not parts or len(parts[-1]) < 3:
        return False
    if name.binding in HELD and parts[0] in {"is", "has"}:
        return False  # a mask or a flag
    if name.binding in HELD:
        tag = tags().get(parts[-1])
        noun = tag is None or tag.startswith(("NN", "CD")) or parts[-1].endswith("ing")
        return not noun and parts[-1] not in NOUNS
    tag = tags().get(parts[0])
    if name.binding != "function" or tag is None:
        return False
    if len(parts) == 1:
        verb = tag.startswith("VB") and tag not in {"VBN", "VBD"}
        return not verb and not tag.startswith("NN")
    return tag.startswith(("IN", "RB", "DT", "JJ", "PR")) and parts[0] not in NOUNS


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--list", action="store_true", help="print each name with its place")
    parser.add_argument("--write", action="store_true", help="write the baseline")
    options = parser.parse_args()
    names: Counter = Counter()
    unclear: Counter = Counter()
    for room, text in python_texts():
        if text.kind == "name" and text.binding != "class" and not text.text.startswith("__"):
            names[room] += 1
            if is_unclear(text):
                unclear[room] += 1
                if options.list:
                    print(f"{text.place}: {text.binding} {text.text}")
    if options.list:
        return 0
    rates = {room: round(100 * unclear[room] / names[room], 2) for room in sorted(names)}
    for room, rate in rates.items():
        print(f"{room:12}{names[room]:7}{unclear[room]:7}{rate:9.2f} per 100")
    print(
        f"{'all':12}{names.total():7}{unclear.total():7}"
        f"{100 * unclear.total() / names.total():9.2f} per 100"
    )
    if options.write:
        BASELINE.write_text(json.dumps(rates, indent=1) + "\n", encoding="utf-8")
        return 0
    baseline = json.loads(BASELINE.read_text(encoding="utf-8"))
    worse = {room for room, rate in rates.items() if rate > baseline.get(room, 0.0) + TOLERANCE}
    for room in sorted(worse):
        print(f"worse: {room}: {baseline.get(room, 0.0)} -> {rates[room]} per 100")
    return bool(worse)


if __name__ == "__main__":
    sys.exit(main())
