"""Van den Doel & Pai 1998, figures 4 to 7: a square membrane, and where it is struck."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.excitation.pluck import Release, impact_amplitudes, impact_impulse, initial_amplitudes
from struck.model.damping import InternalFriction
from struck.model.gains import ShapeGains
from struck.model.material import Material
from struck.shapes import RectangularMembrane, String

Array = NDArray[np.float64]
LOWEST, COUNT = 500.0, 400
# Strike points of figures 5 to 7 with what an independent computation gave: modes that sound,
# centroid of a_n^2 in Hz, centroid of the energies, Q(p) for Psi = sin sin, strongest mode.
FIGURES = {
    (0.1, 0.1): (341, 3326.9521, 5353.4464, 10.06491724, (4, 4)),
    (0.1, 0.4): (305, 2997.1130, 5396.0798, 10.14677622, (2, 1)),
    (0.5, 0.4): (171, 2279.2157, 5477.8532, 10.29740135, (1, 1)),
}


@pytest.fixture(scope="module")
def square() -> struck.ModalModel:
    """The paper's membrane: 1 m by 1 m, lowest at 500 Hz, its first 400 modes."""
    skin = Material(
        density=1000.0,
        youngs_modulus=3e9,
        poisson_ratio=0.4,
        damping=InternalFriction(loss_tangent=0.01),
    )
    speed = 2 * LOWEST / np.sqrt(2)
    drum = RectangularMembrane(
        length=1.0, width=1.0, thickness=1e-3, tension=1000.0 * 1e-3 * speed**2
    )
    highest = 0.5 * (8200.6097 + 8223.4421)  # between modes 400 and 401
    return struck.analyze(drum, skin, band=(20.0, highest), radiation="heuristic1998")


def numbers() -> list[tuple[int, int]]:
    """Return the pairs of half waves of the first 400 modes."""
    pairs = [(m, n) for m in range(1, 60) for n in range(1, 60)]
    return sorted(pairs, key=lambda pair: pair[0] ** 2 + pair[1] ** 2)[:COUNT]


def test_the_spectrum_is_that_of_the_paper(square: struck.ModalModel) -> None:
    expected = [LOWEST * np.sqrt((m * m + n * n) / 2) for m, n in numbers()]
    np.testing.assert_allclose(square.natural_frequencies, expected, rtol=1e-9)
    assert square.natural_frequencies[-1] == pytest.approx(8200.6097, rel=1e-8)


@pytest.mark.parametrize("place", FIGURES)
def test_amplitudes_are_those_of_the_figures(
    square: struck.ModalModel, place: tuple[float, float]
) -> None:
    sounding, centroid, energetic, _, strongest = FIGURES[place]
    amplitudes = impact_amplitudes(square, place)
    frequencies = square.natural_frequencies
    squares = np.square(amplitudes)
    assert np.count_nonzero(squares > 1e-18 * squares.max()) == sounding
    assert squares @ frequencies / squares.sum() == pytest.approx(centroid, rel=1e-6)
    energies = squares * np.square(frequencies)
    assert energies @ frequencies / energies.sum() == pytest.approx(energetic, rel=1e-6)
    loudest = LOWEST * np.sqrt(np.square(strongest).sum() / 2)
    assert frequencies[np.argmax(squares)] == pytest.approx(loudest, rel=1e-9)


def test_brighter_toward_the_corner_by_amplitude_and_not_by_energy() -> None:
    by_amplitude = [centroid for _, centroid, *_ in FIGURES.values()]
    by_energy = [energetic for _, _, energetic, *_ in FIGURES.values()]
    assert by_amplitude == sorted(by_amplitude, reverse=True)
    assert by_energy == sorted(by_energy)


@pytest.mark.parametrize("place", FIGURES)
def test_the_norm_of_the_forms_is_the_papers(
    square: struck.ModalModel, place: tuple[float, float]
) -> None:
    """Q(p) of eq. 11, for forms sin sin, whose mean square is a quarter."""
    gains = square.gains
    assert isinstance(gains, ShapeGains)
    forms = gains.shapes_at(np.array([[*place, 0.0]]))[0, 2] * np.sqrt(square.mass or 0.0) / 2
    assert np.linalg.norm(forms) == pytest.approx(FIGURES[place][3], rel=1e-6)


def test_a_strike_of_that_energy_sounds_with_those_amplitudes(square: struck.ModalModel) -> None:
    """Eq. 10 and 11 by the road that every sound takes: drive, output, 1 / distance."""
    place, energy, distance = (0.1, 0.4), 0.3, 2.5
    contact = square.contact(place)
    drive = square.gains.at(contact.point[None], contact.direction[None])[0, 0]
    listener = square.gains.toward(np.array([[0.5, 0.5, distance]]))[0, 0]
    impulse = impact_impulse(square, place, energy)
    expected = impact_amplitudes(square, place, energy=energy, distance=distance)
    np.testing.assert_allclose(impulse * drive * listener, np.sqrt(2) * expected, rtol=1e-9)


def test_four_times_the_energy_is_twice_the_amplitude(square: struck.ModalModel) -> None:
    one, four = (impact_amplitudes(square, (0.3, 0.2), energy=e) for e in (1.0, 4.0))
    np.testing.assert_allclose(four, 2 * one, rtol=1e-12)


def test_nodal_lines_are_silent(square: struck.ModalModel) -> None:
    """Figure 4: modes with an even number of half waves along x do not move at x = 1/2."""
    amplitudes = impact_amplitudes(square, (0.5, 0.37))
    even = np.array([m % 2 == 0 or n % 2 == 0 for m, n in numbers()])
    frequencies = square.natural_frequencies
    lonely = np.ones(COUNT, bool)  # modes that share a frequency may be mixed
    lonely[1:] &= np.diff(frequencies) > 1e-6
    lonely[:-1] &= np.diff(frequencies) > 1e-6
    silent = lonely & np.array([m % 2 == 0 for m, _ in numbers()])
    assert silent.any()
    assert even[silent].all()
    assert np.abs(amplitudes[silent]).max() < 1e-12 * np.abs(amplitudes).max()


@pytest.mark.prove
def test_a_square_displaced_as_one_form_moves_as_that_form_alone(
    square: struck.ModalModel,
) -> None:
    """Eq. 4 and 5: orthogonal forms, each from its own displacement or velocity."""

    def form(points: Array) -> Array:
        return 2e-3 * np.sin(2 * np.pi * points[:, 0]) * np.sin(2 * np.pi * points[:, 1])

    sines, cosines = initial_amplitudes(square, displacement=form)
    alone = np.flatnonzero([pair == (2, 2) for pair in numbers()])[0]
    assert not sines.any()
    assert abs(cosines[alone]) == pytest.approx(1e-3, rel=1e-6)
    assert np.abs(np.delete(cosines, alone)).max() < 1e-8
    sines, cosines = initial_amplitudes(square, velocity=form)
    rate = 2 * np.pi * square.natural_frequencies[alone]
    assert abs(sines[alone]) == pytest.approx(1e-3 / rate, rel=1e-6)


def test_struck_strings_fall_as_1_over_n_and_plucked_ones_as_its_square() -> None:
    """Section 6: the difference between a piano and a guitar."""
    wire = Material(density=7850.0, youngs_modulus=2e11, poisson_ratio=0.3)
    string = String(length=0.65, radius=2e-4, tension=60.0)
    model = struck.analyze(string, wire, band=(20.0, 8000.0), radiation="heuristic1998")
    place, pulled = 0.65 / 7, 2e-3
    orders = np.arange(1, len(model.frequencies) + 1)
    envelope = np.abs(np.sin(np.pi * orders / 7))
    spoken = envelope > 0.1
    struck_ones = np.abs(impact_amplitudes(model, (place,)))[spoken] / envelope[spoken]
    np.testing.assert_allclose(struck_ones * orders[spoken], struck_ones[0], rtol=1e-6)

    def triangle(points: Array) -> Array:
        x = points[:, 0]
        return pulled * np.minimum(x / place, (0.65 - x) / (0.65 - place))

    _, plucked = initial_amplitudes(model, displacement=triangle)
    closed = 2 * pulled * np.sin(np.pi * orders / 7) / (np.pi * orders) ** 2 / (6 / 49)
    # The forms sqrt(2) sin have a mean square of 1; the kink lies within an element of the rule.
    np.testing.assert_allclose(
        np.abs(plucked[:12]), np.abs(closed[:12]) / np.sqrt(2), atol=3e-3 * np.abs(closed[0])
    )
    released = Release(displacement=triangle, rise=0.2)
    pluck = struck.Pluck(at=(place,), force=1.0, rise=0.2)
    one = struck.render(model, released, seconds=0.5).samples[0]
    other = struck.render(model, pluck, seconds=0.5).samples[0]
    similarity = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    assert abs(similarity) > 0.999
