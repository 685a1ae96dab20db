"""Objects of the room and bodies of the gallery: each gets past its options, two are made."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.explorer.objects import Thing, chair, table, things

gallery = import_module("struck.report.gallery")  # the package names a function so, too
PIECES = [*gallery.SHAPES, *gallery.SOLIDS]


class BegunError(Exception):
    """The work on a body has begun: its options, its mesh and its size were accepted."""


def stop_at_work(stage: str, _fraction: float) -> None:
    """Raise `BegunError` at the first stage after the body was read."""
    if not stage.endswith("cutting the body into elements"):
        raise BegunError(stage)


@pytest.mark.parametrize("thing", things(), ids=lambda thing: thing.name)
def test_every_object_of_the_room_gets_past_its_options(thing: Thing) -> None:
    with pytest.raises(BegunError):
        thing.make(stop_at_work)


@pytest.mark.parametrize("piece", PIECES, ids=lambda piece: piece.name)
def test_every_body_of_the_gallery_gets_past_its_options(
    piece: gallery.Piece, tmp_path: Path
) -> None:
    with pytest.raises(BegunError):
        piece.exhibit(tmp_path, stop_at_work)


def test_recording_of_the_gallery_gets_past_its_options(tmp_path: Path) -> None:
    with pytest.raises(BegunError):
        gallery.recording(tmp_path, stop_at_work)


@pytest.mark.parametrize(("name", "body"), [("table", table), ("chair", chair)])
def test_furniture_is_made_whole(name: str, body: object) -> None:
    thing = next(thing for thing in things() if thing.name == name)
    model = thing.make(lambda _stage, _fraction: None)
    assert model.mass == pytest.approx(struck.Material.named("oak").density * body().volume())
    assert len(model.frequencies) > 20
    assert 20 < model.frequencies.min() < model.frequencies.max() < 2000
    assert np.isfinite(model.decays).all()
    assert model.recoil is not None  # it stands free
