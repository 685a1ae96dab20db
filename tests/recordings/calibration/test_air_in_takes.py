"""Material damping from takes of bodies that lose energy to the air.

The takes have the sound of boundary elements, the models that they are compared with the estimate
by radiated power, so that no calibration knows the true losses.

Where the air takes more than half in the median mode, no mode need be within 10 %, for the sound of
each is known to some dB only: the stated error has to hold the truth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import struck
from struck import InternalFriction, Material, ModalModel, Rayleigh
from struck.model.contact import Place
from struck.model.damping import Damping, contains_air
from struck.recordings.calibration.calibration import calibrated
from struck.solids import Block, Tube, bowl

RATE, LEAD = 48_000, 12_000
LISTENERS = ((0.7, 0.5, 0.6), (-0.5, 0.8, -0.4))  # on no plane of symmetry, m
LOUD, QUIET = 0.5, 5e-4  # peak of a take and standard deviation of its noise: -60 dB


@dataclass(frozen=True, kw_only=True)
class Body:
    shape: Any
    material: str
    damping: Damping
    highest: float
    places: tuple[Place, ...]

    def analyzed(self) -> ModalModel:
        material = Material.named(self.material).damped(self.damping)
        band = (20.0, self.highest)
        return struck.analyze(
            self.shape, material, accuracy="preview", band=band, recoil=False, progress=None
        )


def block(*size: float) -> dict[str, Any]:
    """Return a block with one place at a corner and one off the middle of its top."""
    top = np.array(size) / 2
    corner, middle = top * [0.97, 0.95, 1], top * [0.36, 0.23, 1]
    return {"shape": Block(size=size), "places": (tuple(corner), tuple(middle))}


BODIES = {
    "plate": Body(
        **block(0.20, 0.14, 0.006),
        material="aluminium",
        damping=InternalFriction(loss_tangent=2e-3),
        highest=4500.0,
    ),
    "bar": Body(
        **block(0.20, 0.03, 0.006),
        material="brass",
        damping=InternalFriction(loss_tangent=3e-4),
        highest=9000.0,
    ),
    "board": Body(
        **block(0.25, 0.09, 0.012),
        material="aluminium",
        damping=InternalFriction(loss_tangent=5e-4, external=1.0),
        highest=6000.0,
    ),
    "sheet": Body(  # the air takes nearly all
        **block(0.16, 0.12, 0.004),
        material="aluminium",
        damping=Rayleigh(mass=1.0, stiffness=2e-9),
        highest=7000.0,
    ),
    "bowl": Body(
        shape=bowl(radius=0.06, height=0.045, wall=0.005),
        material="glass",
        damping=InternalFriction(loss_tangent=1e-3),
        highest=7000.0,
        places=("rim", "side"),
    ),
    "tube": Body(
        shape=Tube(length=0.25, radius=0.02, wall=0.003),
        material="steel",
        damping=InternalFriction(loss_tangent=2e-4),
        highest=8000.0,
        places=("end", "middle"),
    ),
}


def taken(model: ModalModel, place: Place, seed: int) -> struck.Sound:
    """Return the take of a strike with noise."""
    strike = struck.Strike(at=place, impulse=0.01, duration=5e-5)
    listener = LISTENERS[seed % len(LISTENERS)]
    sound = struck.render(model, strike, seconds=2.0, listener=listener)
    samples = np.pad(LOUD * sound.samples[0] / sound.peak, (LEAD, 0))
    samples += QUIET * np.random.default_rng(seed).standard_normal(len(samples))
    return struck.Sound(samples=samples[None].astype(np.float32), sample_rate=RATE)


def fitted(model: ModalModel, places: tuple[Place, ...]) -> ModalModel:
    takes = [taken(model, place, seed) for seed, place in enumerate(places)]
    return struck.fit(takes, modes=None, cache=False, progress=None)


@pytest.mark.prove
@pytest.mark.parametrize("name", BODIES)
def test_damping_of_the_material_without_that_of_the_air(name: str) -> None:
    body = BODIES[name]
    true = body.analyzed()
    heard = fitted(true.radiating(band=(20.0, body.highest)), body.places)
    assert not heard.air
    wrong = {"youngs_modulus": 1.1 * true.material.youngs_modulus}
    guess = true.made_of(
        replace(true.material, **wrong, damping=InternalFriction(loss_tangent=0.01))
    )
    found = calibrated(heard, guess)
    material = body.damping.decays(found.frequencies)
    air_takes = 1 - material / found.decays
    errors = found.losses.law.decays(found.frequencies) / material - 1
    stated = found.damping_errors * (1 + errors)
    if np.median(air_takes) <= 0.5:
        assert np.abs(errors[air_takes <= 0.5]).max() < 0.1
    assert (np.abs(errors) < 2 * stated).all()
    assert not contains_air(found.material().damping)
    # Without the air, the material would be blamed.
    blamed = calibrated(heard, replace(guess, air=False))
    assert blamed.air is None
    wrongly = blamed.losses.law.decays(found.frequencies) / material - 1
    assert np.abs(wrongly).max() > 3 * np.abs(errors).max()
