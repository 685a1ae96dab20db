"""Report wording that a reader of technical English has to decode, room by room.

Reads docstrings, comments, messages, command-line help, names and the prose of documents::

    python .ci/plain.py                 # hits by room, compared with .ci/plain.json
    python .ci/plain.py --list told     # the hits of one rule
    python .ci/plain.py --write         # record the present counts as the baseline
    python .ci/plain.py --keyness FOLDER [FOLDER ...]  # words far more frequent than in FOLDER

It fails if a room has more hits of a rule than the baseline says, or if a name of the package is
one of nine words that once stood for everything (`OVERLOADED`). Some hits are false: the counts are
to fall, and readers decide.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import io
import json
import math
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src/struck"
BASELINE = Path(__file__).with_name("plain.json")
DOCUMENTS = "docs"  # the room of Markdown pages
PER_THOUSAND = 1000

# Rules for prose. The replacement of each is in the lexicon of CONTRIBUTING.md.
RULES = {
    "told": r"\btold\b",
    "unless given": r"\bunless (?:given|one is|some are|it is given|they are given)\b",
    "so many": r"\bso (?:many|often|few|long a|much)\b(?! (?:that|as)\b)",
    "as may be": r"\bas (?:may|they may|it may) be\b",
    "nobody": r"\b(?:nobody|anybody|somebody|whoever|whosoever|one who)\b",
    "anew": r"\banew\b",
    "beside": r"\bbeside\b",
    "apart": r"\b(?:tells?|stands?|keeps?|kept|held|holds?) (?:\w+ )?apart\b|\bof each \w+ apart\b",
    "asked": r"\b(?:is|are|was|were) asked\b|\basked (?:for|of)\b|\basks? (?:for|of|whether)\b",
    "says": r"\bsays? (?:so|how|which|what|whether|where|why|all)\b|\b(?:is|are|was) said\b"
    r"|\bsaid so\b|, and said\b",
    "tells": r"\btells? (?:how|which|whether|where|the|a|of|its)\b",
    "looks": r"\b(?:each|first|last|one|a|the|between) looks?\b(?! (?:like|at|up|for|as)\b)"
    r"|\blooks\b (?:\(|of|between)|\blooked at\b",
    "of its own": r"\b(?:of|with) (?:its|their|his|one's) own\b|\bby (?:itself|themselves)\b",
    "alike": r"\blikeness(?:es)?\b|\balike\b",
    "weed": r"\bweed(?:s|ed|ing)?\b|\bcrowd(?:s|ed|ing)?\b",
    "spot": r"\bspots?\b",
    "middles": r"\bmiddles\b|\bmiddle of (?:each|its|an? |the (?:edge|element|side|face))",
    "ways": r"\bways\b",
    "is heard": r"\b(?:what|that|all) is heard\b|\bis heard(?: there| anywhere)?\b",
    "what ...": r"(?:^|\. |: |; )(?:Return |Yield )?(?:what|those|that which|whatever)\b",
    "goes on": r"\b(?:goes|go|went) (?:on|off|along|away|over)\b|\bcomes? (?:in|on|along|of)\b",
    "stands for": r"\bstands? (?:for|in|on|by|there|where)\b",
    "wants": r"\bwants?\b|\bwish(?:es|ed)?\b",
    "gives way": r"\bgiv(?:e|es|ing) way\b|\bmak(?:e|es|ing) (?:room|up for)\b"
    r"|\btak(?:e|es|ing) turns\b",
    "hardly": r"\bhardly\b|\bsomewhat\b|\bmore or less\b",
    "inverted start": r"(?:^|(?<=[.;:] ))(?:Of|And|Or|Whose|Than|(?:To|With|From|In|By|On) which"
    r"|At most so)\b",
    "but for": r"\bbut for\b|\ball but\b|\bnone but\b|\bno \w+ but\b|\bsave for\b",
    "is none": r"\b(?:is|are) none\b|\bnone of (?:a|it|its|them|the)\b",
    "either way": r"\beither way\b|\bby (?:that|so) much\b|\bthe whole of\b",
    "a unit": r"\b(?:samples|points|levels|frames|blocks|nodes|lines|modules|spacings|functions"
    r"|modes|hits|cells) an? (?!few|little|time|factor|number|second\b)[a-z]+\b",
}
PATTERNS = {rule: re.compile(pattern) for rule, pattern in RULES.items()}
TWO_PARAMETERS = "two parameters, one entry"
# Words that say what was done to obtain a value, not what it is; anywhere in a name.
OVERLOADED = {"told", "found", "heard", "kept", "own", "wanted", "share", "way", "apart"}
ROLES = OVERLOADED | {
    *(
        "said",
        "asked",
        "felt",
        "ways",
        "look",
        "looks",
        "looked",
        "word",
        "words",
        "wish",
        "wishes",
    ),
    *("shares", "beside", "anew", "middle", "middles", "turned", "turns", "likeness", "alike"),
    *("spot", "spots", "weed", "weeded", "crowd", "crowded", "begun", "company", "usual"),
    *("these", "those", "such"),
}
# The same for names of one word.
BARE_ROLES = {
    *("given", "held", "seen", "known", "shown", "hidden", "whole", "lasting", "standing", "worth"),
    *("another", "leave", "fewer", "most", "least", "whoever", "somebody", "whatever"),
}
# Participles that are the field's words for a function, and irregular ones.
CLEAR = {
    *("clipped", "sampled", "convolved", "padded", "windowed", "normalised", "resampled"),
    *("filtered", "sorted", "rounded", "scaled", "rotated", "interpolated"),
}
IRREGULAR = {
    *("kept", "held", "found", "told", "said", "given", "seen", "shown", "known", "heard", "felt"),
    *("cut", "split", "bent", "built", "left", "made", "met", "put", "read", "set", "sent", "worn"),
    *("drawn", "grown", "thrown", "hidden", "bound", "wound", "spun", "struck", "begun", "taken"),
}
SHARED_ENTRY = re.compile(r"^(\w+(?:, \w+)+) : (.+)$", re.MULTILINE)
SAYING = {"warn", "note", "say", "inform", "print"}  # functions whose first argument is a message
FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Text:
    """A piece of text or a name.

    Parameters
    ----------
    kind : str
        "docstring", "comment", "message", "help", "document" or "name".
    place : str
        File and line.
    text : str
        The text or the name.
    binding : str
        Of a name: "class", "function", "parameter", "variable", "attribute" or "constant".
    """

    kind: str
    place: str
    text: str
    binding: str = ""


def literal(node: ast.AST) -> str:
    """Return the text of a string literal, an f-string or a sum of them; "" for others."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(literal(v) if isinstance(v, ast.Constant) else "{}" for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mod):
        return literal(node.left) + literal(node.right)
    if isinstance(node, ast.IfExp):
        return literal(node.body) + " | " + literal(node.orelse)
    return ""


def texts(path: Path, name: str) -> Iterator[Text]:
    """Yield the texts and names of a Python file."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    for node in ast.walk(tree):
        yield from _docstrings(node, name)
        yield from _messages(node, name)
    for node, bound, binding in bindings(tree):
        yield Text("name", f"{name}:{node.lineno}", bound, binding)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield Text("comment", f"{name}:{token.start[0]}", token.string.lstrip("#: "))


def _docstrings(node: ast.AST, name: str) -> Iterator[Text]:
    """Yield the docstrings of a definition, those of fields included."""
    if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return
    whole = isinstance(node, ast.Module | ast.ClassDef)
    for statement in node.body if whole else node.body[:1]:
        if isinstance(statement, ast.Expr) and (text := literal(statement.value)):
            yield Text("docstring", f"{name}:{statement.lineno}", inspect.cleandoc(text))


def _messages(node: ast.AST, name: str) -> Iterator[Text]:
    """Yield the messages and the help texts that a node holds."""
    if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
        for argument in node.exc.args:
            if text := literal(argument):
                yield Text("message", f"{name}:{node.lineno}", text)
    if isinstance(node, ast.Call):
        called = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if called in SAYING and node.args and (text := literal(node.args[0])):
            yield Text("message", f"{name}:{node.lineno}", text)
        for keyword in node.keywords:
            if keyword.arg in {"help", "description", "epilog"} and (
                text := literal(keyword.value)
            ):
                yield Text("help", f"{name}:{node.lineno}", text)
    if isinstance(node, ast.Yield) and node.value is not None:
        text = literal(node.value)
        if text.count(" ") > 2:
            yield Text("message", f"{name}:{node.lineno}", text)


def bindings(node: ast.AST, bound: set[str] | None = None) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield each name that is bound, once a scope, with its kind of binding."""
    bound = set() if bound is None else bound
    for child in ast.iter_child_nodes(node):
        inner = bound
        if isinstance(child, ast.ClassDef):
            yield child, child.name, "class"
            inner = set()
        elif isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield child, child.name, "function"
            inner = {argument.arg for argument in _parameters(child.args)}
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from ((each, each.arg, "parameter") for each in _parameters(child.args))
        name = _stored(child)
        if name and name not in bound:
            bound.add(name)
            constant = isinstance(node, ast.Module | ast.Assign) and name.isupper()
            variable = "constant" if constant else "variable"
            yield child, name.lstrip("."), "attribute" if name[0] == "." else variable
        yield from bindings(child, inner)


def _stored(node: ast.AST) -> str:
    """Return the variable, or the attribute after a dot, that a node assigns; "" for others."""
    if not isinstance(getattr(node, "ctx", None), ast.Store):
        return ""
    if isinstance(node, ast.Attribute):
        return "." + node.attr
    return node.id if isinstance(node, ast.Name) else ""


def _parameters(arguments: ast.arguments) -> Iterator[ast.arg]:
    """Yield the parameters of a function, its first `self` or `cls` left out."""
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    every += [each for each in (arguments.vararg, arguments.kwarg) if each]
    yield from (argument for argument in every if argument.arg not in {"self", "cls"})


def words(name: str) -> list[str]:
    """Return the words of a name in lower case."""
    spaced = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name)
    return [word for word in spaced.lower().split("_") if word]


def prose(text: str) -> str:
    """Return a text without code, on one line."""
    text = re.sub(r"^\s*(?:>>>|\.\.\.) .*$", "", text, flags=re.MULTILINE)
    return re.sub(r"\s+", " ", re.sub(r"``[^`]+``|`[^`]+`", "CODE", text))


def offences(text: Text) -> Iterator[tuple[str, str]]:
    """Yield the rules that a text breaks, each with the words around the place."""
    if text.kind == "name":
        yield from _name_offences(text)
        return
    if text.kind == "docstring":
        for match in SHARED_ENTRY.finditer(text.text):
            kinds = match[2].replace("array-like (", "").split("(")[0]
            if "," in kinds:
                yield TWO_PARAMETERS, match[0]
    flat = prose(text.text)
    for rule, pattern in PATTERNS.items():
        for match in pattern.finditer(flat):
            yield rule, flat[max(0, match.start() - 45) : match.end() + 45]


def _name_offences(text: Text) -> Iterator[tuple[str, str]]:
    """Yield the rules that a name breaks."""
    parts = words(text.text)
    roles = [word for word in parts if word in ROLES]
    if not roles and len(parts) == 1 and parts[0] in BARE_ROLES:
        roles = parts
    if roles:
        yield f"name: {roles[0]}", text.text
    elif text.binding == "function" and len(parts) == 1 and parts[0] not in CLEAR:
        regular = re.fullmatch(r"\w{3,}ed", parts[0])
        if regular or parts[0] in IRREGULAR:
            yield "name: bare participle", text.text


def python_texts(package: Path = PACKAGE) -> Iterator[tuple[str, Text]]:
    """Yield rooms and texts of a package."""
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package)
        room = name.parts[0] if len(name.parts) > 1 else path.stem.strip("_")
        yield from ((room, text) for text in texts(path, name.as_posix()))


def document_texts() -> Iterator[tuple[str, Text]]:
    """Yield the prose of README, CONTRIBUTING, CHANGELOG and all pages of docs."""
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    for path in sorted(page for page in pages if "_build" not in page.parts):
        text = FENCE.sub("", path.read_text(encoding="utf-8"))
        text = re.sub(r"\]\([^)]*\)", "]", text)
        yield DOCUMENTS, Text("document", path.relative_to(ROOT).as_posix(), text)


def counts(source: Iterable[tuple[str, Text]]) -> tuple[dict[str, Counter], Counter]:
    """Return the hits of each rule by room, and the words and names by room and kind."""
    hits: dict[str, Counter] = defaultdict(Counter)
    sizes: Counter = Counter()
    for room, text in source:
        sizes[room, text.kind] += 1 if text.kind == "name" else len(text.text.split())
        hits[room].update(rule for rule, _ in offences(text))
    return hits, sizes


def table(hits: dict[str, Counter], sizes: Counter) -> Iterator[str]:
    """Yield the lines of the report."""
    rooms = sorted({room for room, _ in sizes})
    yield "room            words   hits  per 1000 |  names   hits  per 100"
    for name, group in [*((room, [room]) for room in rooms), ("all", rooms)]:
        names = sum(sizes[room, "name"] for room in group)
        length = sum(n for (room, kind), n in sizes.items() if room in group and kind != "name")
        of_names = sum(
            n for room in group for rule, n in hits[room].items() if rule.startswith("name: ")
        )
        of_prose = sum(hits[room].total() for room in group) - of_names
        yield (
            f"{name:12}{length:9}{of_prose:7}{PER_THOUSAND * of_prose / max(length, 1):10.2f} |"
            f"{names:7}{of_names:7}{100 * of_names / max(names, 1):9.2f}"
        )


def worse(now: dict[str, Counter], baseline: dict[str, dict[str, int]]) -> list[str]:
    """Return a line for each rule that a room breaks more often than in the baseline."""
    return [
        f"{room}: {rule}: {baseline.get(room, {}).get(rule, 0)} -> {number}"
        for room, rules in sorted(now.items())
        for rule, number in sorted(rules.items())
        if number > baseline.get(room, {}).get(rule, 0)
    ]


def ratchet(now: dict[str, Counter], path: Path, *, write: bool) -> int:
    """Compare counts with a baseline file, or write it; return the exit code."""
    if write:
        kept = {room: dict(sorted(rules.items())) for room, rules in sorted(now.items()) if rules}
        path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
        return 0
    lines = worse(now, json.loads(path.read_text(encoding="utf-8")))
    print(*(f"worse: {line}" for line in lines), sep="\n", end="\n" if lines else "")
    return bool(lines)


def overloaded(source: Iterable[tuple[str, Text]]) -> list[str]:
    """Return the names that are an overloaded word and nothing else, each with its place."""
    names = (text for _, text in source if text.kind == "name")
    return [f"{name.place}: {name.text}" for name in names if name.text.strip("_") in OVERLOADED]


def keyness(mine: Counter, reference: Counter) -> Iterator[str]:
    """Yield words more than four times as frequent as in a reference, by log-likelihood."""
    here, there = mine.total(), reference.total()
    rows = []
    for word, n in mine.items():
        if n < 8 or len(word) < 3:
            continue
        m = reference[word]
        expected = [total * (n + m) / (here + there) for total in (here, there)]
        likelihood = 2 * n * math.log(n / expected[0])
        likelihood += 2 * m * math.log(m / expected[1]) if m else 0.0
        ratio = n / here * there / (m + 0.5)
        if ratio > 4 and likelihood > 30:
            rows.append((likelihood, f"{word:18}{n:6}{m:6} x{ratio:8.1f} {likelihood:8.0f}"))
    yield from (line for _, line in sorted(rows, reverse=True))


def word_counts(folders: Iterable[Path]) -> Counter:
    """Return how often each word occurs in the docstrings and messages of packages."""
    number: Counter = Counter()
    for folder in folders:
        for _, text in python_texts(folder):
            if text.kind not in {"name", "comment"}:
                number.update(re.findall(r"[a-z]+", prose(text.text).lower()))
    return number


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--list", metavar="RULE", help="print the hits of one rule")
    parser.add_argument("--write", action="store_true", help="write the baseline")
    parser.add_argument("--keyness", nargs="+", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    if options.keyness:
        print(*keyness(word_counts([PACKAGE]), word_counts(options.keyness)), sep="\n")
        return 0
    source = [*python_texts(), *document_texts()]
    if options.list:
        for _, text in source:
            for rule, around in offences(text):
                if rule == options.list:
                    print(f"{text.place}: [{text.kind}] {around}")
        return 0
    hits, sizes = counts(source)
    print(*table(hits, sizes), sep="\n")
    names = overloaded(source)
    print(*(f"overloaded: {name}" for name in names), sep="\n", end="\n" if names else "")
    return ratchet(hits, BASELINE, write=options.write) or bool(names)


if __name__ == "__main__":
    sys.exit(main())
