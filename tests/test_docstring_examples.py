"""Examples in docstrings run, and print what they show."""

from __future__ import annotations

import doctest
import inspect
import sys
from pathlib import Path

import numpy as np
import pytest

import struck
from tests.test_words import public

EXAMPLES = {
    name: text for name, value in public().items() if ">>>" in (text := inspect.getdoc(value) or "")
}


# The cheapest stay in every run, in all some 2 s of a processor; others take up to seconds each.
QUICK = {
    "struck.Damping",
    "struck.ForceTrack",
    "struck.InternalFriction",
    "struck.Material",
    "struck.Measured",
    "struck.Mesh",
    "struck.ModalModel",
    "struck.Mono",
    "struck.Rayleigh",
    "struck.Reverberation",
    "struck.Roughness",
    "struck.Sound",
    "struck.Strike",
    "struck.analysis.tune",
    "struck.ears.Trajectory",
    "struck.ears.wall_materials",
    "struck.excitation.Profile",
    "struck.excitation.Tool",
    "struck.excitation.TouchLog",
    "struck.excitation.contact_time",
    "struck.excitation.roughnesses",
    "struck.excitation.strikers",
    "struck.files.Cache",
    "struck.load",
    "struck.materials",
    "struck.recordings.Take",
    "struck.save",
    "struck.scene.Contacts",
    "struck.scene.Poses",
    "struck.scene.RigidBody",
    "struck.shapes.Bar",
    "struck.shapes.Shape",
    "struck.solids.Block",
    "struck.solids.Extrusion",
    "struck.solids.Stem",
    "struck.solids.VolumeMesh",
    "struck.solids.bell",
    "struck.solids.wine_glass",
    "struck.synth.Resonators",
}
# Names that users call, besides all of `struck`, `struck.shapes` and `struck.solids`.
CALLED = {
    "struck.analysis.tune",
    "struck.ears.MeasuredHead",
    "struck.ears.SphereHead",
    "struck.ears.Trajectory",
    "struck.ears.wall_materials",
    "struck.excitation.Profile",
    "struck.excitation.Tool",
    "struck.excitation.TouchLog",
    "struck.excitation.roughnesses",
    "struck.excitation.strikers",
    "struck.files.Cache",
    "struck.files.list_parts",
    "struck.files.load_surface",
    "struck.recordings.Take",
    "struck.recordings.fit_recordings",
    "struck.scene.Contacts",
    "struck.scene.Poses",
    "struck.scene.RigidBody",
    "struck.scene.Scene",
    "struck.scene.Simulation",
    "struck.synth.Resonators",
}
# Needs an audio device: its example is a block of code.
SILENT = {"struck.play"}


def needed() -> set[str]:
    """Return the names that must have an example that runs."""
    rooms = {"struck", "struck.shapes", "struck.solids"}
    return {name for name in public() if name.rpartition(".")[0] in rooms} | CALLED


def test_each_verb_and_each_class_that_users_make_has_an_example() -> None:
    assert public().keys() >= CALLED
    assert not needed() - EXAMPLES.keys() - SILENT
    assert all("code-block" in (inspect.getdoc(public()[name]) or "") for name in SILENT)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in QUICK else pytest.mark.prove)
        for name in sorted(EXAMPLES)
    ],
)
def test_example_prints_what_it_shows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    home = sys.modules[inspect.unwrap(public()[name]).__module__]
    namespace = {**vars(home), "np": np, "struck": struck}
    test = doctest.DocTestParser().get_doctest(EXAMPLES[name], namespace, name, None, 0)
    output: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    runner.run(test, out=output.append)
    assert not runner.summarize(verbose=False).failed, "".join(output)
