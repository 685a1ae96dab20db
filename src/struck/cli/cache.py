"""The command of the shell that shows and clears the cache."""

from __future__ import annotations

import argparse

from struck.cli import Result
from struck.files.cache import opened
from struck.model.provenance import TerminalProgress

EXAMPLES = ("--clear",)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck cache`."""
    parser.add_argument("--clear", action="store_true", help="remove all entries")


def run(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    """Run `struck cache`."""
    cache = opened()
    if cache is None:
        return Result("the cache is off, by STRUCK_CACHE or for want of a home", folder=None)
    removed = cache.clear() if options.clear else 0
    entries = cache.entries()
    size = sum(entry.size for entry in entries)
    lines = [
        f"folder   {cache.folder}",
        f"entries  {len(entries)}",
        f"size     {size / 2**20:.1f} MiB of at most {cache.most_bytes / 2**20:.0f} MiB",
        *([f"removed  {removed}"] if options.clear else []),
    ]
    return Result(
        lines,
        folder=str(cache.folder),
        entries=len(entries),
        bytes=size,
        most_bytes=cache.most_bytes,
        removed=removed,
    )
