"""Writers of files: each writes an old or a new version of its files into a folder."""

from __future__ import annotations

import io
import json
import os
import queue
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import h5py
import numpy as np
import soundfile
from matplotlib.figure import Figure

import struck
from struck import errors, files, perception, recordings, report, scene, solids
from struck.batch import batch, cluster, job_process
from struck.batch.batch_report import BatchReport
from struck.batch.job import BodyJob
from struck.explorer import jobs, server
from struck.explorer.private_folder import PrivateFolder
from struck.files import sofa_fields
from struck.model import NumberTable
from struck.recordings.capture import SimulatedRecorder
from struck.recordings.capture_plan import read_plan
from struck.report import obrien2002
from struck.scene import stems
from tests import hostile_calls as calls
from tests.batch.bodies import bar as write_bar
from tests.recordings.hits import LEAD_IN, RATE, SECONDS, hit, write

gallery = import_module("struck.report.gallery")  # not the function of that name
MATERIALS = ("oak", "steel")  # of the old and the new version
_DATE = re.compile(rb"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(?:\.\d+)?|D:\d{14}")
_NUMBER = re.compile(rb"[0-9a-f]{32}|[a-z][0-9a-f]{10}")  # of a run; of a part of a picture
SETTINGS = (  # what would make two runs differ, or takes long and is not written
    (os, "fsync", lambda _: None),
    (job_process, "_cost", lambda: {"cpu": 1.0, "memory": 1.0}),
    (job_process, "analyze", lambda _file, material, **_: block(MATERIALS.index(material))),
    (batch, "Processes", lambda folder, **_: Crew(folder)),
    (BatchReport, "_page", lambda report: f"a page of {report}"),
    (obrien2002, "_played", lambda staged, folder, *_: played(staged, folder)),
    (obrien2002, "contact_sheet", lambda *_, **__: Figure(figsize=(1, 1))),
    (gallery, "overview", lambda *_, **__: Figure(figsize=(1, 1))),
    (gallery, "analyze", lambda *_, **__: block(1)),
    (gallery, "find_spec", lambda _: None),
    (gallery, "fit_recordings", lambda *_, **__: calls.fitting()),
    (gallery, "report", lambda _: "the page of a fit"),
    (gallery, "page", lambda *_: "the page of a body"),
    (gallery, "section", lambda _: "the section of a body"),
)


def masked(data: bytes) -> object:
    """Return content without what differs between runs."""
    return _NUMBER.sub(b"", _DATE.sub(b"", data))


def samples(data: bytes) -> object:
    """Return the samples of a sound whose file holds a time or a random number."""
    return soundfile.read(io.BytesIO(data))[0].tobytes()


def fields(data: bytes) -> object:
    """Return what a SOFA file holds, which has times of its own in binary form, too."""
    with h5py.File(io.BytesIO(data), "r") as file:
        texts = {name: str(value) for name, value in file.attrs.items() if "Date" not in name}
        values = {name: file[name][()].tobytes() for name in file}
    return texts, values


@dataclass(frozen=True, kw_only=True)
class Writer:
    """A function that writes version 0 or 1 of some files into a folder."""

    write: Callable[[Path, int], object]
    content: Callable[[bytes], object] = masked  # what two files of one version have in common
    # Files that tell of a failure too, and whether one is whole.
    reports: Mapping[str, Callable[[bytes], bool]] = field(default_factory=dict)
    quiet: bool = False  # whether it goes on without the file where it cannot be written


REPORTS: Mapping[str, Callable[[bytes], bool]] = {
    "out/report.csv": lambda data: data.endswith(b"\n"),
    "out/report.json": lambda data: bool(json.loads(data)),
    "out/report.html": bool,  # a stand-in
}


@cache
def block(version: int) -> struck.ModalModel:
    body = solids.Block(size=(0.08, 0.01, 0.01), elements=(4, 1, 1))
    return struck.analyze(body, MATERIALS[version], cache=False)


@cache
def sound(version: int) -> struck.Sound:
    time = np.arange(2400) / 16_000
    tone = np.sin(2 * np.pi * (500 + 200 * version) * time) * np.exp(-10 * time)
    return struck.Sound(samples=tone, sample_rate=16_000)


@cache
def comparison() -> report.Comparison:
    return struck.compare(block(0), block(1), progress=None)


@cache
def drawn_map() -> struck.SoundMap:
    return struck.sound_map(block(1), 20.0, progress=None)


def contacts(version: int) -> scene.Contacts:
    return replace(calls.hit(), time=np.array([0.01 * (1 + version)]))


def falling(version: int) -> scene.Scene:
    block_that_falls = scene.Body(model=block(version), excitations=struck.Strike())
    return scene.Scene(
        bodies={"floor": scene.Body(model=scene.RigidBody()), "bar": block_that_falls}
    )


def sounds(folder: Path, version: int) -> None:
    tones = {f"tone{number}": sound(number) for number in range(1 + version)}
    files.save_set(tones, folder / "set")


def bank(folder: Path, version: int) -> None:
    perception.write_bank(drawn_map(), folder / "bank", lambda *_: sound(version))


def map_of(folder: Path, version: int) -> None:
    replace(drawn_map(), level=80.0 + version).save(folder / "map.safetensors")


def picture(ending: str, folder: Path, version: int) -> None:
    with patch("struck.report.model_pictures.overview", lambda *_, **__: drawing(version)):
        struck.show(block(version), folder / f"bar{ending}")


def drawing(version: int) -> Figure:
    figure = Figure(figsize=(1, 1))
    figure.suptitle(str(version))
    return figure


def page_of_fit(folder: Path, version: int) -> None:
    with patch("struck.report.fit_page.report", lambda _: f"page {version} of a fit"):
        report.save_report(calls.fitting(), folder / "fit.html")


def page_of_comparison(folder: Path, version: int) -> None:
    with patch.object(report.Comparison, "page", lambda _: f"comparison {version}"):
        comparison().save_page(folder / "comparison.html")


def responses(folder: Path, version: int) -> None:
    sofa_fields.save_sofa_responses(
        block(version),
        folder / "responses.sofa",
        contacts=["top"],
        listeners=[[1.0, 0.0, 0.0]],
        seconds=0.01,
        sample_rate=8000,
    )


def gains(folder: Path, version: int) -> None:
    where = {"contacts": ["top"], "listeners": [[1.0, 0.0, 0.0]]}
    with np.errstate(all="ignore"), warnings_ignored():
        struck.save(block(version), folder / "gains.sofa", **where)


@contextmanager
def warnings_ignored() -> Iterator[None]:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def takes(folder: Path, version: int) -> None:
    rehearsal = folder.parent / "rehearsal"
    if not rehearsal.exists():
        rehearsal.mkdir()
        for number in (1, 2):
            write(rehearsal / f"rim_front_{number}.wav", hit(seed=number))
    (rehearsal / "plan.toml").write_text(
        f"seconds = {SECONDS}\nlead_in = {LEAD_IN}\nsample_rate = {RATE}\nhits = {1 + version}\n"
        '[[contacts]]\nname = "rim"\nat = [1.0]\n[[listeners]]\nname = "front"\nat = [0, 1, 0]\n'
    )
    recordings.capture(
        read_plan(rehearsal / "plan.toml"), folder / "takes", SimulatedRecorder(rehearsal)
    )


class Crew:
    """Does the jobs of a batch in this process."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._jobs = folder, deque[BodyJob]()

    def free(self) -> bool:
        return not self._jobs

    def start(self, job: BodyJob) -> None:
        self._jobs.append(job)

    def finished(self, _seconds: float) -> tuple[BodyJob, Any]:
        job = self._jobs.popleft()
        return job, job_process.done(job, self._folder, lambda *_: None)

    def close(self) -> None:
        """Nothing runs any longer."""


def meshes(folder: Path) -> list[str]:
    """Return the files of a body and of its copy."""
    source = folder.parent / "meshes"
    if not source.exists():
        source.mkdir()
        write_bar(source / "bar.vtu", 0.08, 0.01, 0.01)
        (source / "copy.vtu").write_bytes((source / "bar.vtu").read_bytes())
    return [str(source / "bar.vtu"), str(source / "copy.vtu")]


def many(kind: str, labels: str, folder: Path, version: int) -> None:
    """Analyze two files; the strikes of the old version are of another kind and more."""
    strikes = [{"at": "top", "impulse": 0.01}] * (2 - version)
    options = {"strikes": strikes, "sounds": kind, "labels": labels, "seconds": 0.01}
    inputs = meshes(folder)[: 1 if kind else 2]
    made = struck.analyze_many(
        inputs,
        MATERIALS[version],
        out=folder / "out",
        cache=False,
        **(options if kind else {}),
        **calls_rate(kind),
    )
    for row in made.failed:
        raise getattr(errors, row.failure)(row.message)


def calls_rate(kind: str) -> dict[str, int]:
    return {"sample_rate": 8000} if kind else {}


def from_a_cluster(folder: Path, version: int) -> None:
    """Take the files of a job from a worker that does not share the folder."""
    job = BodyJob(file="a.obj", output="below/bar", material="steel", options={}, key=str(version))
    facts = {"key": job.key, "files": {"below/bar.struck": 3}}
    contents = {"below/bar.struck": b"%d" % version, "below/bar.json": json.dumps(facts).encode()}
    future = SimpleNamespace(
        status="finished", result=lambda **_: {"contents": contents, "facts": facts}
    )
    crew: Any = object.__new__(cluster.Cluster)
    crew._folder, crew._running, crew._events = folder, {}, queue.SimpleQueue()
    key = Future(future)
    crew._running[key] = job, "tcp://worker"
    crew._events.put(key)
    _, answer = crew.finished(1.0)
    if "failure" in answer:
        raise getattr(errors, answer["failure"])(answer["message"])


class Future:
    """A future that can be a key."""

    def __init__(self, fields: SimpleNamespace) -> None:
        self.status, self.result = fields.status, fields.result


def played(staged: Any, folder: Path) -> obrien2002.Played:  # noqa: ANN401
    version = int(staged.text)
    obrien2002.ready(staged, folder, "preview")
    return obrien2002.Played(
        staged=staged,
        scene=falling(version),
        contacts=contacts(version),
        sounds={staged.name: sound(version)},
    )


def scene_of_2002(folder: Path, version: int) -> None:
    staged = obrien2002.Staged(
        name="chimes",
        title="",
        text=str(version),
        mjcf=f"<mujoco model='{version}'><worldbody><geom size='1'/></worldbody></mujoco>",
        models={},
        materials={"*": "steel"},
        seconds=0.02,
        listener=(0.0, -1.0, 0.0),
    )
    with patch.dict(obrien2002.SCENES, chimes=lambda *_: staged):
        report.scene2002("chimes", folder / "scene", accuracy="preview")


def separate_sounds(folder: Path, version: int) -> None:
    stems.save_stems(
        falling(version), folder / "mix.wav", factor=1e-3, seconds=0.02, sample_rate=8000
    )


def pages(folder: Path, version: int) -> None:
    """Make a page of a formula, an entry of a mesh and that of the recording."""
    box = calls.box()
    shape = gallery.Piece(
        name="string", body=lambda: solids.Block(size=(1, 1, 1)), material="steel",
        sounds=(("a blow", struck.Strike(time=0.001 * version)),),
    )  # fmt: skip
    solid = replace(shape, name="chime", body=lambda: box)
    renders = lambda *_, **__: sound(version)  # noqa: E731
    with (
        patch.object(gallery, "SHAPES", (shape,)),
        patch.object(gallery, "SOLIDS", (solid,)),
        patch.object(gallery, "render", renders),
        patch.object(gallery, "SOLIDS_INTRODUCTION", f"introduction {version}"),
    ):
        report.gallery(folder / "gallery", pieces=["string", "chime", "tabla"])


def simulated(folder: Path, version: int) -> None:
    """Write what `struck simulate` writes next to its sound."""
    from struck.cli import simulate

    with patch.object(simulate, "contact_sheet", lambda *_, **__: drawing(version)):
        simulate._write_others(
            folder / "fall.wav",
            falling(version),
            scene.events_of(falling(version), contacts(version)),
            [{"event": "strike", "time": version}],
            sound(version),
            0.02,
            lambda *_: None,
        )


def cached(folder: Path, version: int) -> None:
    files.Cache(folder / "cache").put("ab" * 32, b"content" * (1 + version))


def redirect(folder: Path, version: int) -> None:
    room: Any = object.__new__(PrivateFolder)
    room.path = folder
    room.write_private("open.html", f"<p>{version}</p>")


def of_room(folder: Path, version: int) -> None:
    jobs._write_model(block(version), folder / "block.struck")


def head(folder: Path, version: int) -> None:
    """Write a file that is not there in the old version."""
    with patch.object(server, "head_bytes", lambda *_: b"head"):
        if version:
            server._write_head(folder, "kemar", "8000")


def table(folder: Path, version: int) -> None:
    columns = {"energy (J)": np.array([1.0, version])}
    files.save_table(NumberTable(columns=columns), folder / "a.csv")


def sound_as(name: str, folder: Path, version: int) -> None:
    sound(version).save(folder / name)


def log_as(name: str, folder: Path, version: int) -> None:
    scene.save_contacts(contacts(version), folder / name)


def model_as(name: str, folder: Path, version: int) -> None:
    struck.save(block(version), folder / name)


WRITERS: dict[str, Writer] = {
    **{
        f"sound.{ending}": Writer(
            write=partial(sound_as, f"a.{ending}"),
            content=samples if ending in {"ogg", "aiff"} else masked,
        )
        for ending in ("wav", "flac", "ogg", "mp3", "aiff")
    },
    **{f"log.{e}": Writer(write=partial(log_as, f"a.{e}")) for e in ("csv", "jsonl", "npz")},
    **{f"model.{e}": Writer(write=partial(model_as, f"a.{e}")) for e in ("struck", "vtu")},
    "model.sofa": Writer(write=gains, content=fields),
    "responses.sofa": Writer(write=responses, content=fields),
    "sound set": Writer(write=sounds),
    "animation": Writer(
        write=lambda folder, version: scene.save_animation(
            falling(version), folder / "a.glb", seconds=0.1 + version
        )
    ),
    "table of numbers": Writer(write=table),
    "sound map": Writer(write=map_of),
    "bank": Writer(write=bank),
    **{
        f"picture{ending}": Writer(write=partial(picture, ending))
        for ending in (".png", ".pdf", ".svg")
    },
    "page of a fit": Writer(write=page_of_fit),
    "page of a comparison": Writer(write=page_of_comparison),
    "gallery": Writer(write=pages),
    "scene of 2002": Writer(write=scene_of_2002),
    "stems": Writer(write=separate_sounds),
    "simulation": Writer(write=simulated),
    "takes": Writer(write=takes),
    "batch": Writer(write=partial(many, "", "labels.csv"), reports=REPORTS),
    "batch with WAV files": Writer(write=partial(many, "wav", "labels.csv"), reports=REPORTS),
    "batch with NPZ files": Writer(write=partial(many, "npz", "labels.parquet"), reports=REPORTS),
    "cluster": Writer(write=from_a_cluster),
    "cache": Writer(write=cached, quiet=True),
    "redirect": Writer(write=redirect),
    "room": Writer(write=of_room),
    "head": Writer(write=head),
}
