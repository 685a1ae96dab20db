"""Outputs of a body that is resized or made of another material, without a new decomposition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import struck
from struck.radiation import RadiatedPower
from struck.solids import Block


def test_a_body_twice_as_large_sounds_by_the_law_of_similarity() -> None:
    """At equal wave number times size pressure goes with size^-1/2 for a unit modal velocity."""
    body = struck.analyze(
        Block(size=(0.2, 0.1, 0.02)), "glass", accuracy="preview", band=(20, 12_000)
    )
    for factor in (0.5, 1.7):
        changed = body.scaled(factor).gains.outputs
        assert np.allclose(changed, body.gains.outputs * factor**-0.5, rtol=1e-12, atol=0)
    assert np.allclose(body.scaled(3).scaled(1 / 3).gains.outputs, body.gains.outputs, rtol=1e-12)


def test_what_was_prepared_changes_no_output() -> None:
    body = struck.analyze(
        Block(size=(0.2, 0.1, 0.02)), "glass", accuracy="preview", band=(20, 12_000)
    )
    other = replace(body, gains=replace(body.gains, radiation=RadiatedPower()))
    twice = [each.made_of("steel").gains.outputs for each in (body, other, body)]
    assert np.allclose(twice[1], twice[0], rtol=1e-12, atol=0)
    assert np.array_equal(twice[2], twice[0])
