"""What the page is sent: models of a size that it takes, and heads."""

from __future__ import annotations

import numpy as np
import pytest

import struck
from struck.errors import OptionError
from struck.explorer.page_files import head_bytes, refined, thin_model
from struck.files.model_file import from_bytes, to_bytes
from struck.model.gains import ShapeGains
from struck.model.model import ModalModel
from struck.solids import Block


@pytest.fixture(scope="module")
def block() -> ModalModel:
    body = Block(size=(0.4, 0.06, 0.03))
    return struck.analyze(body, "steel", accuracy="preview", band=(20, 12000))


def sent(model: ModalModel, most: int) -> ModalModel:
    return from_bytes(to_bytes(thin_model(refined(model), most)))


def test_a_body_that_fits_is_sent_as_it_is(block: ModalModel) -> None:
    assert refined(block) is block
    assert thin_model(block) is block


def test_a_large_body_is_sent_with_audible_modes_on_fewer_vertices_and_says_so(
    block: ModalModel,
) -> None:
    assert isinstance(block.gains, ShapeGains)
    vertices = len(block.gains.surface.points)
    most = block.gains.shapes.nbytes // 4
    small = sent(block, most)
    assert isinstance(small.gains, ShapeGains)
    assert small.gains.shapes.nbytes <= 1.02 * most
    left = len(small.gains.surface.points)
    dropped = small.provenance.dropped
    assert any("modes are not heard" in note for note in dropped) or len(small.frequencies) == len(
        block.frequencies
    )
    assert f"{vertices - left} of {vertices} vertices were left out" in dropped[-1]
    # Where it was clicked on, it answers nearly as it did.
    rng = np.random.default_rng(1)
    points = block.gains.surface.points[rng.integers(0, vertices, 40)]
    kept = [int(np.argmin(np.abs(block.frequencies - each))) for each in small.frequencies[:4]]
    before = block.gains.shapes_at(points)[:, :, kept]
    after = small.gains.shapes_at(points)[:, :, : len(kept)]
    weights = np.abs(after).max(axis=(0, 1)) / np.abs(before).max(axis=(0, 1))
    assert np.abs(after / weights - before).max() < 0.1 * np.abs(before).max()


def test_an_unknown_head_is_refused_with_those_there_are() -> None:
    with pytest.raises(OptionError, match="head is 'dummy': give one of kemar, exact"):
        head_bytes("dummy", 48000)
    with pytest.raises(OptionError, match="sample_rate 100 Hz"):
        head_bytes("exact", 100)
