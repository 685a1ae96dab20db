"""Report sizes: lines and modules by room, long functions and long files. Nothing is limited."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "src/struck"
LONG_BODY, LONG_FILE = 80, 1000  # lines, from which on a function and a file are listed


def body_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines of a function without its signature and docstring."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def main() -> None:
    """Print the report."""
    lines: Counter = Counter()
    modules: Counter = Counter()
    long: list[tuple[int, str]] = []
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE)
        text = path.read_text(encoding="utf-8")
        room = name.parts[0] if len(name.parts) > 1 else "(root)"
        number = text.count("\n")
        lines[room] += number
        modules[room] += 1
        if number > LONG_FILE:
            long.append((number, name.as_posix()))
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                number = body_lines(node)
                if number > LONG_BODY:
                    long.append((number, f"{name.as_posix()}:{node.name}"))
    for room, number in lines.most_common():
        print(f"{room:12}{number:7} lines{modules[room]:5} modules")
    print(f"{'all':12}{lines.total():7} lines{modules.total():5} modules")
    for number, where in sorted(long, reverse=True):
        print(f"{number:5} lines: {where}")


if __name__ == "__main__":
    main()
