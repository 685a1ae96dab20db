"""The shell: the same verbs as in Python, one module a command."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn, TextIO

import struck
from struck.cli import memory_limit
from struck.errors import (
    CacheWarning,
    LossWarning,
    OptionError,
    RepairWarning,
    ScaleWarning,
    StruckError,
    nearest,
    printable,
    rounded,
)
from struck.model.provenance import TerminalProgress

COMMANDS = {
    "analyze": "compute the modes of a body and save its model",
    "analyze-many": "compute the models of many mesh files, and a data set of their sounds",
    "radiate": "compute the timbre field of a model: the directivity of each mode",
    "info": "print the contents of a model, or the parts of a mesh file",
    "show": "draw the shape, modes and spectrum of a model",
    "render": "strike, scrape, roll on, pluck or hold a model, and save the sound",
    "simulate": "simulate the rigid bodies of a scene file, and save the sound of their contacts",
    "sound-map": "choose the contacts whose sounds represent the whole surface of a body",
    "play": "play models live with the keyboard",
    "explore": "show objects in a browser, where a click strikes them",
    "record": "record the takes of a plan, or resume an interrupted measurement",
    "fit": "fit a model to recordings of one object",
    "compare": "compare a model with a recording of the body, or with another model",
    "calibrate": "estimate a material from recordings of a body and a model of its shape",
    "export": "write the gains of a model as a SOFA file, or its mode shapes as VTU",
    "tune": "find the dimension at which a body rings at a given frequency",
    "materials": "list materials with their constants and sources",
    "cache": "show or clear the cache of intermediate results",
    "demo": "make a gallery of sounds and pictures",
}
UNWRITTEN = 1
BAD_INPUT = 2
SOME_FAILED = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code: 0, 1 unwritten, 2 bad input, 3 if some failed."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by who started us
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - open until the process ends
    try:
        if refusal := memory_limit.prepare():
            return _refuse(MemoryError(refusal), words)
        return _run(words)
    except Exception as error:
        if not memory_limit.is_shortage(error):
            raise
        return _refuse(MemoryError(memory_limit.explain(error)), words)


def _run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    try:
        options = _parsed(arguments)
    except SystemExit:
        if _print(""):  # help, which waits to be written
            return UNWRITTEN
        raise
    except OptionError as error:
        return _refuse(error, arguments)
    if isinstance(options, str):
        return _print(options)
    progress = TerminalProgress(quiet=options.quiet)
    try:
        with warnings_in_one_line(options.in_shell_words):
            result = options.run(options, progress)
    except StruckError as error:
        progress.close()  # before the message
        message = str(error) if _raised_by_shell(error) else options.in_shell_words(str(error))
        return _refuse(type(error)(message), arguments)
    finally:
        progress.close()
    plain = options.in_shell_words("\n".join(map(printable, result.lines)))
    facts = result.facts
    if isinstance(notes := facts.get("notes"), list):
        facts["notes"] = list(map(options.in_shell_words, notes))
    text = json.dumps(facts, indent=2) if options.json else plain
    return _print(text + "\n") or result.code


def _print(text: str) -> int:
    """Print, and return the exit code: 0 also when the reader has gone, as `head` does."""
    try:
        try:
            sys.stdout.write(text)
        except UnicodeEncodeError:  # by an encoding that lacks some letters
            kind = sys.stdout.encoding
            sys.stdout.write(text.encode(kind, "backslashreplace").decode(kind))
        sys.stdout.flush()
    except OSError as error:
        # What is left must not be tried again at the end of the process.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            complain(f"the result cannot be written ({error.strerror}): free some space there")
            return UNWRITTEN
    return 0


def _refuse(error: StruckError | MemoryError, words: Sequence[str]) -> int:
    """Print an error in one line on standard error and, with --json, as JSON on standard output."""
    complain(str(error))
    if "--json" in words:
        _print(json.dumps({"error": str(error), "kind": type(error).__name__}, indent=2) + "\n")
    return BAD_INPUT


def _number(kind: type[float], text: str) -> float:
    """Return the number, or the whole number, in the text of an option."""
    with suppress(ValueError):
        return kind(text)
    form = "a whole number" if kind is int else "a number alone, in the unit that --help names"
    raise argparse.ArgumentTypeError(f"it is {text!r}: give {form}")


class Once(argparse.Action):
    """Action that keeps the value of an option, and refuses a second one."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,  # noqa: ARG002 - argparse gives it
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        """Keep the value; ArgumentError if there is one."""
        earlier_values = namespace.given
        values = values if self.nargs != 0 else not str(option_string).startswith("--no-")
        if option_string is not None and self.dest in earlier_values:
            conflict = f"it is {earlier_values[self.dest]!r}, and {values!r} too"
            conflict_text = conflict if self.nargs != 0 else "both"
            raise argparse.ArgumentError(self, f"{conflict_text}: give it once")
        if "" in (values if isinstance(values, list) else [values]):
            raise argparse.ArgumentError(self, "it is empty: give a value, or leave it out")
        earlier_values[self.dest] = values
        setattr(namespace, self.dest, values)


class OnOff(Once, argparse.BooleanOptionalAction):
    """Action of an option and its --no-, of which one is given."""


class Parser(argparse.ArgumentParser):
    """Argument parser that raises errors, and takes vectors that begin below 0."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:  # noqa: ANN401 - as its base
        super().__init__(*arguments, **keywords)
        self.set_defaults(parser=self, given={})  # for `refuse`
        vars(self)["_negative_number_matcher"] = re.compile(r"-\.?\d")  # as of Python 3.14
        self.register("action", None, Once)
        for kind in (int, float):
            self.register("type", kind, partial(_number, kind))

    def error(self, message: str) -> NoReturn:
        """Raise an OptionError, with the option for a vector that is given for a number."""
        vector = re.match("argument --(impulse|speed|force): .*,.*,", message)
        if vector and "--direction" in self._option_string_actions:
            message += ", and which way by --direction x,y,z"
        name = message.rpartition("argument ")[2].partition(":")[0]
        if message.endswith("expected one argument") and name.startswith("--"):
            message += f"; one that begins with a minus as {name}=-z"
        raise OptionError(f"{message}: see '{self.prog} --help'")


def _parsed(words: Sequence[str]) -> argparse.Namespace | str:
    """Return the options in `words`, or the text to print for `--help` and the like."""
    if "--version" in words[:1]:
        return f"struck {struck.__version__}\n"
    chosen = next((word for word in words if not word.startswith("-")), None)
    parser = Parser(
        prog="struck",
        description="Compute the sounds of physical objects from their shape and material.",
        epilog="To cite struck, see CITATION.cff in its sources; 'struck info MODEL --all' lists "
        "the papers behind a model.",
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    if chosen and chosen not in COMMANDS:
        meaning = _COMMAND_MEANINGS.get(chosen.lower())
        suggestion = f"did you mean {meaning}? " if meaning else nearest(chosen, COMMANDS)
        raise OptionError(
            f"struck has no command {chosen!r}: {suggestion}there are {', '.join(COMMANDS)}"
        )
    if words and chosen is None and not {"-h", "--help"} & {*words}:
        suggestion = nearest(words[0].lstrip("-"), ("help", "version"), "--{}")
        parser.error(f"struck has no option {words[0]!r}: {suggestion}give a command")
    one = _declare_commands(parser, chosen)
    if not words:
        return parser.format_help()
    options, unknown = parser.parse_known_args(words)
    if unknown and one:
        name = unknown[0].partition("=")[0]
        suggestion = ""
        if name[:1] == "-":
            suggestion = _suggest_option(one, str(chosen), name.lstrip("-").lower())
        one.error(f"{one.prog} does not take {unknown[0]!r}: {suggestion}leave it out")
    return options


# Commands and options that people type, and what they mean by them, where `nearest` knows no name.
_COMMAND_MEANINGS: Mapping[str, str] = {
    **dict.fromkeys(("list", "ls"), "materials (of materials) or analyze --list (of bodies)"),
    **dict.fromkeys(("strike", "hit", "sound", "scrape", "roll", "pluck", "wav"), "render"),
    **dict.fromkeys(("convert", "save", "write", "sofa"), "export"),
    **dict.fromkeys(("model", "compute", "solve", "mesh", "modes", "modal"), "analyze"),
    **dict.fromkeys(("view", "plot", "draw", "picture", "image"), "show"),
    **dict.fromkeys(("listen", "live", "keyboard"), "play"),
    **dict.fromkeys(("batch", "dataset", "data-set"), "analyze-many"),
    **dict.fromkeys(("serve", "server", "gui", "room", "browser", "open"), "explore"),
    **dict.fromkeys(("measure", "mic", "capture"), "record"),
    **dict.fromkeys(("directivity", "field", "bem"), "radiate"),
    **dict.fromkeys(("map", "bank"), "sound-map"),
    **dict.fromkeys(("gallery", "example", "examples", "tutorial"), "demo"),
    **dict.fromkeys(("material", "table"), "materials"),
    **dict.fromkeys(("describe", "print", "stat", "parts"), "info"),
    **dict.fromkeys(("scene", "physics", "mujoco"), "simulate"),
    **dict.fromkeys(("note", "pitch", "optimize"), "tune"),
    **dict.fromkeys(("diff",), "compare"),
    **dict.fromkeys(("help",), "--help"),
    **dict.fromkeys(("version",), "--version"),
}
_OPTION_MEANINGS: Mapping[str, tuple[str, str]] = {
    # by option: one that the command must have, and what is meant
    **{name: ("accuracy", f"--accuracy {name}") for name in ("preview", "standard", "fine")},
    **dict.fromkeys(("fast", "draft", "quick", "rough"), ("accuracy", "--accuracy preview")),
    **dict.fromkeys(("csv", "table", "machine"), ("json", "--json, a result for machines")),
    **dict.fromkeys(
        ("midi", "notes"),
        ("strikes", "--strikes TABLE, of strikes with their names (MIDI is not read)"),
    ),
    **dict.fromkeys(("verbose", "v", "debug"), ("quiet", "--quiet, the opposite")),
    **dict.fromkeys(("mono",), ("listener", "--listener, which is one ear")),
}


def _suggest_option(parser: argparse.ArgumentParser, command: str, name: str) -> str:
    """Return the option that an unknown one means: by its meaning, then by its spelling.

    Between the two come other commands that have an option of that very name, or one of that
    meaning.
    """
    known = [item.lstrip("-") for item in parser._option_string_actions]  # noqa: SLF001 - argparse has no public list
    required_name, meaning = _OPTION_MEANINGS.get(name, ("", ""))
    if required_name in known:
        return f"did you mean {meaning}? "
    suggestion = nearest(name, known, "--{}", spelling=False)
    if suggestion:
        return suggestion
    other_options = {other: _list_options(other) for other in COMMANDS if other != command}
    for other, options in other_options.items():
        if name in options:
            return f"--{name} is an option of struck {other}: "
    for other, options in other_options.items():
        if suggestion := nearest(name, options, f"--{{}} of struck {other}", spelling=False):
            return suggestion
    return nearest(name, known, "--{}")


def _list_options(command: str) -> list[str]:
    """Return the long names of a command's options, without their dashes."""
    parser = Parser()
    declare(parser, command)
    return [item[2:] for item in parser._option_string_actions if item.startswith("--")]  # noqa: SLF001 - argparse has no public list


def _declare_commands(parser: Parser, chosen: str | None) -> Parser | None:
    """Declare all commands, and return the parser of the chosen one, which alone is imported."""
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    chosen_parser = None
    for name, description in COMMANDS.items():
        command_parser = commands.add_parser(
            name,
            help=description,
            description=description,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name == chosen:
            declare(command_parser, name)
            chosen_parser = command_parser
    return chosen_parser


def declare(parser: argparse.ArgumentParser, name: str) -> None:
    """Give a parser the options, the examples and the work of the command of that name."""
    module = import_module(f"struck.cli.{name.replace('-', '_')}")
    parser.epilog = "example:\n" + "\n".join(f"  struck {name} {line}" for line in module.EXAMPLES)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--quiet", action="store_true", help="do not print progress")
    parser.set_defaults(run=module.run, in_shell_words=partial(in_shell_words, parser))
    module.declare(parser)


# Advice of the library, which speaks Python, in the words of the shell.

_OTHERS = ("analyze", "radiate", "fit")  # whose options are named where a command lacks them
_OPTION_SYNONYMS = {
    "models": "model",
    "materials": "material",
    "walls": "wall",
    "sample_rate": "rate",
}
_OPTION_SYNONYMS |= {"at": "strike", "out": "output", "path": "output", "threshold_db": "threshold"}
# The pattern of an argument, with or without a value. It passes over quoted text and over calls, as
# in what a body is printed as.
_CALL = r"\w+\((?:[^()]|\([^()]*\))*\)"
_QUOTED_TEXT = r"(?<=[ (])'[^']*'"
_ARGUMENT = re.compile(
    rf"""{_QUOTED_TEXT}|\b{_CALL}|(?<![\w.,:{{/\\])(?<!--material )([a-z_]{{2,}})=(?!\w+\.[a-z])"""
    rf"""(?:'([^']*)'|"([^"]*)"|\(([-\d., ]+)\)|({_CALL}|[\w.]*\w))?"""
)
_NUMBER = r"-?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
_PHRASES: Mapping[str, str] = {
    r", as in model\.\w+\([^)]*\)|[:;] struck\.scene\.infer_contacts finds [a-z ]+": "",
    r"\b(?:model|ModalModel)\.radiating\(\)": "struck radiate",
    r"\bstruck\.(\w+)\((\w+)=\)": r"struck \1 --\2",
    r"of struck\.solids(?: or struck\.shapes)?": "of 'struck analyze --list'",
    (
        r"\b(?:(?:struck|model|ModalModel)\.\w+|Body|Contacts|Mono|RigidBody|Scene|Stereo|Binaural)"
        r"\((?:[^()]|\(\))*\)"
    ): r"\g<0> (in Python)",
}


def in_shell_words(parser: argparse.ArgumentParser, text: str) -> str:
    """Return a message with its arguments as options: `units='mm'` as `--units mm`."""
    for phrase, words in _PHRASES.items():
        text = re.sub(phrase, words, text)

    def subject(match: re.Match[str]) -> str:
        action = _action(parser, match[0])
        return action.option_strings[-1] if action else match[0]

    text = re.sub("^[a-z_]+(?= (?:is|are|names) )", subject, text)

    def option(match: re.Match[str]) -> str:
        if match[1] is None:
            return match[0]
        value = next((group for group in match.groups()[1:] if group), "")
        for name in (None, *_OTHERS):
            command_parser = parser if name is None else Parser()
            if name is not None:
                declare(command_parser, name)
            action = _action(command_parser, match[1])
            if action is not None:
                long_option = f"--{match[1]}"
                words = [
                    long_option
                    if long_option in action.option_strings
                    else action.option_strings[-1]
                ]
                words += [value.replace(" ", "")] if value and action.nargs != 0 else []
                return " ".join([*words, *([f"of struck {name}"] if name else ())])
        return f"{match[0]} (in Python)"

    def plain(match: re.Match[str]) -> str:
        return ",".join(rounded(float(number)) for number in re.split(r"[, ]+", match[1]))

    text = _ARGUMENT.sub(option, text).replace("(x, y, z)", "x,y,z")
    return re.sub(rf"(?<= )[(\[] *({_NUMBER}(?:[, ]+{_NUMBER})+),? *[)\]]", plain, text)


def _action(parser: argparse.ArgumentParser, name: str) -> argparse.Action | None:
    """Return the option for an argument of Python, if there is one."""
    options = [item for item in parser._actions if item.option_strings]  # noqa: SLF001 - argparse has no public list
    option_names = {name, _OPTION_SYNONYMS.get(name, name)}
    flags = {f"--{item.replace('_', '-')}" for item in option_names}
    return next(
        (item for item in options if item.dest in option_names or flags & {*item.option_strings}),
        None,
    )


def _raised_by_shell(error: StruckError) -> bool:
    """Return whether an error comes from here, in words of the shell already."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is None or trace.tb_frame.f_globals["__name__"].startswith("struck.cli")


# What all commands have in common.


class Result:
    """Result of a command: `facts` for machines, `lines` for people, and the exit code.

    A text is one line: a line break in it comes from a name, and is printed escaped.
    """

    def __init__(self, text: str | Sequence[str], **facts: object) -> None:
        self.lines = [text] if isinstance(text, str) else list(text)
        self.facts = facts
        self.code = 0


def complain(message: str) -> None:
    """Print a message in one line on standard error, if it is open."""
    with suppress(OSError):
        sys.stderr.write(f"struck: {printable(message)}\n")


_SHOWN_WARNINGS = (CacheWarning, LossWarning, RepairWarning, ScaleWarning)


@contextmanager
def warnings_in_one_line(in_words: Callable[[str], str] = str) -> Iterator[None]:
    """Print each warning in one line, without code, in words of the shell."""
    shown = warnings.showwarning

    def tell(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if issubclass(category, _SHOWN_WARNINGS):
            complain(in_words(str(message)))
        else:
            shown(message, category, filename, lineno, file, line)

    with warnings.catch_warnings():
        for category in _SHOWN_WARNINGS:
            warnings.simplefilter("always", category)
        warnings.showwarning = tell
        yield
