"""Every public function and every option of the shell that reads a file has a fuzz target."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from functools import cache
from types import UnionType

from struck.cli import COMMANDS, Parser, declare
from tests.fuzz.targets import TARGETS
from tests.test_words import parameters, public


def targets(*kinds: str) -> tuple[str, ...]:
    """Return the names of the targets whose first word is one of these."""
    return tuple(name for name in TARGETS if name.partition(" ")[0] in kinds)


MODELS = ("model", "gains sofa")
SURFACES = targets("surface")
MESHES = (*SURFACES, "body", *targets("volume"))
LISTS = ("manifest toml", "manifest csv")
RECORDINGS = (*targets("take"), *LISTS)
CACHE = ("cache entry", "cached result")
SCENES = targets("scene")
JOBS = ("jobs csv", "jobs toml")
STRIKES = ("strikes csv", "strikes toml")

# What a path is for: targets that read such a file, "written" (also a folder), or "a course" and
# the like, which are no paths of files.
PUBLIC: dict[str, tuple[str, ...] | str] = {
    "struck.Binaural hrtf": ("head sofa",),
    "struck.ForceTrack force": ("force wav",),
    "struck.Material.from_lame": "no file",
    "struck.Roll path": "a course",
    "struck.Roll.reader path": "a course",
    "struck.Scrape path": "a course",
    "struck.Scrape.reader path": "a course",
    "struck.Sound.load path": targets("sound")[1:],
    "struck.Sound.save path": "written",
    "struck.SoundMap.load path": ("sound map",),
    "struck.SoundMap.save path": "written",
    "struck.analyze body": MESHES,
    "struck.analyze cache": CACHE,
    "struck.analyze_many cache": CACHE,
    "struck.analyze_many files": MESHES,
    "struck.analyze_many out": ("facts",),
    "struck.analyze_many strikes": STRIKES,
    "struck.analyze_many table": JOBS,
    "struck.batch.BatchReport folder": "written",
    "struck.batch.BatchRow file": "no file",
    "struck.compare other": (*MODELS, *targets("take")),
    "struck.ears.MeasuredHead.read path": ("head sofa",),
    "struck.files.Cache folder": CACHE,
    "struck.files.list_parts path": SURFACES,
    "struck.files.load_body path": (*SURFACES, "body"),
    "struck.files.load_sofa_responses path": ("responses sofa",),
    "struck.files.load_surface path": SURFACES,
    "struck.files.load_volume path": targets("volume"),
    "struck.files.save_set folder": "written",
    "struck.files.save_table path": "written",
    "struck.fit cache": CACHE,
    "struck.fit geometry": (*SURFACES, "body"),
    "struck.fit manifest": LISTS,
    "struck.fit recordings": RECORDINGS,
    "struck.fit report": "written",
    "struck.fit room": targets("take"),
    "struck.load path": MODELS,
    "struck.perception.write_bank folder": "written",
    "struck.recordings.Manifest path": "no file",
    "struck.recordings.Manifest.chosen files": "no file",
    "struck.recordings.Take.load path": targets("take"),
    "struck.recordings.capture folder": ("manifest written", "take wav"),
    "struck.recordings.fit_recordings cache": CACHE,
    "struck.recordings.fit_recordings geometry": (*SURFACES, "body"),
    "struck.recordings.fit_recordings manifest": LISTS,
    "struck.recordings.fit_recordings recordings": RECORDINGS,
    "struck.recordings.fit_recordings room": targets("take"),
    "struck.recordings.read_manifest path": LISTS,
    "struck.recordings.read_plan path": ("plan",),
    "struck.report.Comparison.save_page path": "written",
    "struck.report.gallery folder": "written",
    "struck.report.save_report path": "written",
    "struck.report.scene2002 folder": "written",
    "struck.save path": "written",
    "struck.scene.Simulation cache": CACHE,
    "struck.scene.Simulation file": SCENES,
    "struck.scene.Simulation folder": SCENES,
    "struck.scene.load_animation path": targets("animation"),
    "struck.scene.load_contacts path": targets("log"),
    "struck.scene.save_animation path": "written",
    "struck.scene.save_contacts path": "written",
    "struck.show path": "written",
    "struck.simulate file": SCENES,
    "struck.tune body": MESHES,
}

_LISTENER = {"--walk": ("walk",), "--hrtf": ("head sofa",)}
SHELL: dict[str, dict[str, tuple[str, ...] | str]] = {
    "analyze": {
        "body": MESHES,
        "-o": "written",
        **dict.fromkeys(("--part", "--units", "--up", "--radiation"), "a name"),
    },
    "analyze-many": {
        "files": MESHES,
        "--table": JOBS,
        "--strikes": STRIKES,
        "-o": ("facts",),
        "--labels": "written",
        **dict.fromkeys(("--part", "--units", "--up", "--radiation", "--sounds"), "a name"),
    },
    "calibrate": {
        "model": MODELS,
        "recordings": (*MODELS, *targets("take")),
        "--corrected": "written",
    },
    "compare": {"model": MODELS, "other": (*MODELS, *targets("take")), "-o": "written"},
    "demo": {"--out": "written"},
    "explore": {"models": MODELS},
    "export": {
        "model": MODELS,
        "-o": "written",
        **dict.fromkeys(("--title", "--author", "--licence"), "a name"),
    },
    "fit": {
        "recordings": RECORDINGS,
        "--manifest": LISTS,
        "--geometry": (*SURFACES, "body"),
        "--room": targets("take"),
        "--report": "written",
        "-o": "written",
        "--interpolation": "a name",
    },
    "info": {"file": (*MODELS, *SURFACES), "--units": "a name"},
    "play": {"models": MODELS, **_LISTENER},
    "radiate": {"model": MODELS, "-o": "written"},
    "record": {
        "plan": ("plan",),
        "--simulate": ("take wav",),
        "-o": ("manifest written",),
        "--device": "a name",
    },
    "render": {
        "model": MODELS,
        "--strikes": STRIKES,
        "-o": "written",
        "--encoding": "a name",
        "--sounds": "a name",
        **_LISTENER,
    },
    "show": {"model": (*MODELS, "plan"), "-o": "written"},
    "simulate": {
        "scene": SCENES,
        "--folder": SCENES,
        "--model": (*MODELS, *MESHES),
        "--log": "written",
        "-o": "written",
        **dict.fromkeys(("--friction", "--restitution", "--mute", "--convex"), "a name"),
        **_LISTENER,
    },
    "sound-map": {
        "model": MODELS,
        **dict.fromkeys(("--bank", "--parameters", "-o"), "written"),
    },
    "tune": {"body": MESHES},
}
# Words of a help text about what may be a path.
FILES = re.compile(
    r"\b(files?|folders?|pages?|tables?|models?|plans?|manifests?|sounds?|recordings?|SOFA|scenes?"
    r"|logs?|pictures?|meshes)\b",
    re.IGNORECASE,
)
UNION = re.compile(r"[\w.]+( \| [\w.]+)+")  # of types, in a text
READING = re.compile(r"(load|read|from)(_|$)")


@cache
def path_aliases() -> set[str]:
    """Return the names of types, as the modules of the package define them, that have a path."""
    values = {
        name: str(value)
        for module_name, module in [*sys.modules.items()]
        if module_name.partition(".")[0] == "struck"
        for name, value in vars(module).items()
        if isinstance(value, UnionType) or (isinstance(value, str) and UNION.fullmatch(value))
    }
    aliases = {"Path", "PathLike"}
    while (
        more := {name for name, text in values.items() if aliases & {*re.findall(r"\w+", text)}}
        - aliases
    ):
        aliases |= more
    return aliases


def public_paths() -> Iterator[str]:
    """Yield "name parameter" for paths that public names take, and readers without one."""
    for name, value in public().items():
        kinds = parameters(value)
        paths = [
            key
            for key, kind in kinds.items()
            if key in {"path", "file", "folder"} or path_aliases() & {*re.findall(r"\w+", kind)}
        ]
        yield from (f"{name} {key}" for key in paths)
        if READING.match(name.rpartition(".")[2]) and not paths:
            yield name


def shell_paths() -> Iterator[tuple[str, str]]:
    """Yield commands and options with free text whose help speaks of files or models."""
    for command in COMMANDS:
        parser = Parser()
        declare(parser, command)
        for action in parser._actions:
            if isinstance(action, argparse._HelpAction) or action.nargs == 0:
                continue
            if action.type is None and FILES.search(f"{action.help} {action.metavar}"):
                yield command, (action.option_strings or [action.dest])[0]


def test_every_public_reader_has_a_target() -> None:
    paths = set(public_paths())
    assert sorted(paths - PUBLIC.keys()) == [], "add a fuzz target, and name it in PUBLIC"
    assert sorted(PUBLIC.keys() - paths) == [], "they are gone: take them out of PUBLIC"


def test_every_file_of_the_shell_has_a_target() -> None:
    paths = set(shell_paths())
    listed = {(command, name) for command, names in SHELL.items() for name in names}
    assert sorted(paths - listed) == [], "add a fuzz target, and name it in SHELL"
    assert sorted(listed - paths) == [], "they are gone: take them out of SHELL"


def test_every_target_is_of_a_reader_and_every_reader_has_one() -> None:
    uses = [*PUBLIC.values(), *(use for names in SHELL.values() for use in names.values())]
    used = {name for use in uses if isinstance(use, tuple) for name in use}
    assert used == TARGETS.keys()
    assert all(uses)  # an empty tuple is no target
