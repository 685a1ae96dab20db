"""Energy that strikes leave in a body, compared with that of their strikers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from struck.errors import rounded
from struck.excitation.strike import Blow, Strike, find_rigid_mass
from struck.model.arrays import Array
from struck.model.contact import Contact
from struck.model.model import ModalModel
from struck.synth.ring_down import pulse_work


def recoil_energy(model: ModalModel, contact: Contact, blow: Blow) -> float:
    """Return the energy of a free body's motion as a whole after a blow, J."""
    return blow.impulse**2 / (2 * find_rigid_mass(model, contact))


def note_yielding(
    strikes: Sequence[Strike],
    blows: Sequence[Blow],
    contacts: Sequence[Contact],
    model: ModalModel,
    drives: Array,
) -> str:
    """Return a note of blows that bring less energy than they leave in the body.

    `drives` (K, M), kg^-1/2, are those of the modes at each contact. Hertz's blow meets a rigid
    body; a light one yields while it is touched, and takes less.
    """
    ratios = [0.0]
    poles = -model.decays + 2j * np.pi * model.frequencies
    unit_energies: dict[float, Array] = {}
    for strike, blow, contact, mode_drives in zip(strikes, blows, contacts, drives, strict=True):
        striker_energy = strike.striker_energy(model, contact)
        if striker_energy is None:
            continue
        if blow.duration not in unit_energies:
            unit_energies[blow.duration] = pulse_work(poles, blow.duration)
        mode_energy = blow.impulse**2 * np.square(mode_drives) @ unit_energies[blow.duration]
        ratios.append(float(mode_energy + recoil_energy(model, contact, blow)) / striker_energy)
    max_ratio, count = max(ratios), sum(ratio > 1 for ratio in ratios)
    places = "the modes" if model.supported else "the modes and the motion as a whole"
    note = (
        f"{count} of {len(strikes)} strikes leave up to {rounded(max_ratio, 2)} times the "
        f"striker's energy in {places}: the body is too light to stay at rest under the blow, and "
        f"would sound at least {10 * np.log10(max(max_ratio, 1.0)):.1f} dB softer; take a lighter "
        "or a softer striker"
    )
    return note if count else ""
