"""Energy of strikes: what the rendered samples hold, what an integration of the modes gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import struck
from struck import ForceTrack, Hold, Material, ModalModel, Pluck, Scrape, Strike
from struck.errors import OptionError
from struck.excitation.hertz import Striker, effective_mass
from struck.model.gains import ShapeGains
from struck.model.material import AIR, Air
from struck.model.timbre_table import SinglePoint
from struck.radiation.radiated_power import RadiatedPower
from struck.scene import Energy
from struck.scene.body import Action
from struck.shapes import Bar, CircularPlate, RectangularPlate, RoundSection, String
from struck.solids import Block
from struck.synth.mode_energy import energies_of_pulses
from struck.synth.ring_down import Pulse, pulse_work

Array = NDArray[np.float64]
RATE = 48_000
FAR = 100.0  # m: far outside of each body

# Closed forms and blocks, each with the highest frequency of its modes, Hz.
BODIES = {
    "bar": (Bar(length=0.3, width=0.03, thickness=0.005), 8000),
    "chime": (Bar(length=0.505, section=RoundSection(radius=0.0125, wall=0.001)), 8000),
    "short bar": (Bar(length=0.12, width=0.02, thickness=0.004), 16000),
    "strip": (Bar(length=0.2, width=0.05, thickness=0.002), 8000),
    "held bar": (Bar(length=0.25, width=0.02, thickness=0.004, ends="clamped"), 8000),
    "plate": (RectangularPlate(length=0.3, width=0.2, thickness=0.002), 2000),
    "thick plate": (RectangularPlate(length=0.4, width=0.3, thickness=0.01), 4000),
    "sheet": (RectangularPlate(length=0.25, width=0.2, thickness=0.001), 2000),
    "disc": (CircularPlate(radius=0.1, thickness=0.002), 4000),
    "gong": (CircularPlate(radius=0.2, thickness=0.004), 1500),
    "block": (Block(size=(0.2, 0.03, 0.01)), 8000),
    "square": (Block(size=(0.15, 0.15, 0.004)), 5000),
}
MATERIALS = ("steel", "aluminium", "glass", "oak", "abs")
STRIKERS = ("wood", "rubber", "steel", "felt", "fingertip")
CASES = [*product(BODIES, MATERIALS)]
SAMPLE = (
    ("bar", "oak"), ("chime", "abs"), ("short bar", "glass"), ("strip", "aluminium"),
    ("held bar", "oak"), ("plate", "abs"), ("thick plate", "oak"), ("disc", "oak"),
    ("gong", "abs"), ("block", "oak"),
)  # fmt: skip
PLATE = RectangularPlate(length=0.3, width=0.2, thickness=0.002)


@cache
def model_of(body: str, material: str) -> ModalModel:
    shape, highest = BODIES[body]
    options = {"accuracy": "preview"} if isinstance(shape, Block) else {}
    return struck.analyze(shape, material, band=(20, highest), progress=None, **options)


def seconds_of(model: ModalModel, energy: Energy) -> float:
    """Return how long a sound takes to hold all but 0.1 % of the radiated energy, s."""
    order = np.argsort(-energy.radiated)
    sums = np.cumsum(energy.radiated[order])
    loud = order[: 1 + np.searchsorted(sums, 0.9995 * sums[-1])]
    return float(min(3.0 / model.decays[loud].min() + 0.05, 40.0))


def radiated(model: ModalModel, actions: Action | Sequence[Action], seconds: float) -> float:
    """Return the energy of a rendered sound over all directions, J."""
    assert model.centre is not None
    listener = model.centre + np.array([0.0, 0.0, FAR])
    sound = struck.render(model, actions, seconds=seconds, fade=0, listener=listener)
    square = np.square(sound.samples[0].astype(float)).sum() / RATE
    return float(4 * np.pi * FAR**2 / AIR.impedance * square)


def check(body: str, material: str, strikers: tuple[str, ...]) -> None:
    model = model_of(body, material)
    silent = replace(model, recoil=None)
    for striker in strikers:
        strike = Strike(striker=striker, speed=1.0)
        energy = struck.energy(model, strike)
        seconds = seconds_of(model, energy)
        total = energy.total
        assert energy.striker == pytest.approx(Striker.named(striker).mass / 2)
        # Of a body without sharp resonances the modes' sounds interfere: by pressure, not energy.
        # After 40 s up to 9 % still ring in a sheet of aluminium.
        assert radiated(silent, strike, seconds) == pytest.approx(energy.modes_sound, rel=0.1)
        assert radiated(model, strike, seconds) <= total["entered"] + energy.recoil
        parts = ("material", "support", "hold", "surface", "sound")
        assert sum(total[name] for name in parts) == pytest.approx(total["entered"], rel=1e-9)
        assert min(getattr(energy, name).min() for name in parts) >= 0


@pytest.mark.parametrize(("body", "material"), SAMPLE)
def test_radiated_energy_is_that_of_the_rendered_sound(body: str, material: str) -> None:
    check(body, material, STRIKERS[:3])


@pytest.mark.prove
@pytest.mark.parametrize(("body", "material"), CASES)
def test_every_body_radiates_no_more_than_it_got(body: str, material: str) -> None:
    check(body, material, STRIKERS)


def alone(model: ModalModel, mode: int) -> ModalModel:
    """Return a model with one of its modes, and without recoil."""
    modes = np.array([mode])
    names = ("frequencies", "natural_frequencies", "decays", "poisson_slopes", "errors")
    return replace(
        model,
        **{name: getattr(model, name)[modes] for name in names},
        gains=model.gains.weighted(modes, np.ones(1)),
        recoil=None,
    )


LOSSES = (0.002, 0.02, 0.2)
CYCLES = (0.0, 0.1, 0.5, 0.75, 1.5, 3.2)  # frequency times duration; at 1.5 the spectrum vanishes


@pytest.mark.parametrize("loss", LOSSES)
def test_energy_of_one_mode_alone(loss: float) -> None:
    law = struck.InternalFriction(loss_tangent=loss)
    disc = model_of("disc", "aluminium").damped(law)
    for mode in (0, 1, 2):  # 0 and 1 share a frequency, and their sounds are a quarter period apart
        model = alone(disc, mode)
        for cycles in CYCLES:
            duration = cycles / model.frequencies[0]
            strike = Strike(at=(0.05, 0.02), impulse=0.01, duration=duration)
            energy = struck.energy(model, strike)
            seconds = min(4.0 / model.decays[0], 30.0) + duration
            assert radiated(model, strike, seconds) == pytest.approx(
                energy.radiated[0], rel=0.01
            ), (mode, cycles)
            assert energy.modes_sound == pytest.approx(energy.radiated[0], rel=1e-6)
            # What the mode loses is what the sound has, but for the sound under the force.
            if loss < 0.01 and cycles < 1:
                assert energy.sound[0] == pytest.approx(energy.radiated[0], rel=0.05)


@pytest.mark.parametrize("cycles", [0.2, 0.5, 1.5, 4.0])
@pytest.mark.parametrize("decay", [0.0, 20.0, 900.0])
def test_work_is_that_of_the_equation_of_motion(cycles: float, decay: float) -> None:
    """Integrate q'' + 2 d q' + (w^2 + d^2) q = F with the work F q' and the loss 2 d q'^2."""
    frequency, impulse = 500.0, 0.3
    rate = 2 * np.pi * frequency
    duration = cycles / frequency

    def motion(time: float, state: Array) -> list[float]:
        place, speed, _, _ = state
        force = impulse * np.pi / (2 * duration) * np.sin(np.pi * time / duration)
        pull = (rate**2 + decay**2) * place + 2 * decay * speed
        return [speed, force - pull, force * speed, 2 * decay * speed**2]

    answer = solve_ivp(motion, (0.0, duration), np.zeros(4), "DOP853", rtol=1e-10, atol=1e-16).y[
        :, -1
    ]
    stored = (answer[1] ** 2 + (rate**2 + decay**2) * answer[0] ** 2) / 2
    assert answer[3] + stored == pytest.approx(answer[2], rel=1e-6, abs=1e-12)
    pole = np.array([-decay + 1j * rate])
    work = impulse**2 * pulse_work(pole, duration)[0]
    assert work == pytest.approx(answer[2], rel=1e-5, abs=1e-11)
    pulse = Pulse(gains=np.full(1, impulse, complex), onset=0.0, duration=duration)
    (computed,) = energies_of_pulses(pole, [pulse], np.ones((1, 1), complex)).inputs
    assert computed == pytest.approx(work, rel=1e-4, abs=1e-11)


def test_strikes_that_overlap_are_one_push() -> None:
    """Two halves of a strike at once, and one that falls into the ringing of another."""
    model = alone(model_of("bar", "steel"), 1)
    whole = Strike(at="end", impulse=0.02, duration=1e-3)
    half = replace(whole, impulse=0.01)
    one, two = struck.energy(model, whole), struck.energy(model, [half, half])
    assert two.entered == pytest.approx(one.entered)
    assert two.radiated == pytest.approx(one.radiated)
    strikes = [
        whole,
        replace(whole, time=0.4e-3),
        replace(half, time=0.02),
        Strike(at="middle", impulse=0.01, time=0.03),
    ]
    energy = struck.energy(model, strikes)
    seconds = 6.0 / model.decays[0]
    assert radiated(model, strikes, seconds) == pytest.approx(energy.modes_sound, rel=0.03)


def test_what_enters_a_plucked_mode_is_what_bends_it() -> None:
    """A load F bends a mode by drive F / w0^2; letting go leaves (drive F / w0)^2 / 2."""
    string = struck.analyze(
        String(length=0.65, radius=0.0005, tension=70.0), "steel", band=(20, 2000), progress=None
    )
    contact = string.contact("quarter")
    drives = string.gains.at(contact.point[None], contact.direction[None])[0, 0]
    energy = struck.energy(string, Pluck(at="quarter", force=2.0, rise=0.2))
    expected = np.square(2.0 * drives / (2 * np.pi * string.natural_frequencies)) / 2
    strong = expected > 1e-3 * expected.max()
    np.testing.assert_allclose(energy.entered[strong], expected[strong], rtol=0.01)
    assert energy.striker is None


@pytest.mark.parametrize(
    "actions",
    [
        Strike(at="end", impulse=0.01, duration=4e-4, shape="hertz"),
        Strike(at="end", impulse=0.01, duration=4e-4, patch=0.003),
        [Strike(at="end", impulse=0.01, shape="gaussian", duration=2e-3), Strike(at="middle")],
        Strike(at="end", impulse=0.01, transient=0.1),
        [Strike(at="end", striker="wood"), Hold(at="middle", time=0.01, seconds=0.05)],
        [Strike(at="end", striker="wood", time=0.01), Hold(at="end", grip=3.0)],
        ForceTrack(at="end", force=np.sin(np.arange(4800) * 0.1), sample_rate=RATE),
        Scrape(path=[(0.02, 0.0, 0.0025), (0.1, 0.0, 0.0025)], speed=0.4, load=1.0),
    ],
)
def test_other_excitations_agree_with_their_sound(actions: Action | Sequence[Action]) -> None:
    model = replace(model_of("bar", "oak"), recoil=None)
    energy = struck.energy(model, actions)
    assert radiated(model, actions, 1.2) == pytest.approx(energy.modes_sound, rel=0.03)
    losses = energy.material + energy.support + energy.hold + energy.surface + energy.sound
    np.testing.assert_allclose(losses, energy.entered, rtol=1e-9)
    is_held = isinstance(actions, list) and isinstance(actions[1], Hold)
    assert (energy.total["hold"] > 0.1 * energy.total["entered"]) == is_held


def test_recoil_is_the_energy_of_a_rigid_body_and_its_sound() -> None:
    die = struck.analyze(
        Block(size=(0.012, 0.012, 0.012)), "steel", accuracy="preview", progress=None
    )
    place, down = (0.006, 0.002, 0.006), (0, 0, -1)  # later than 0 s, where the sound begins
    strike = Strike(at=place, impulse=0.001, duration=3e-5, direction=down, time=0.001)
    energy = struck.energy(die, strike)
    contact = die.contact(strike.at, strike.direction)
    assert die.mass is not None
    assert die.centre is not None
    assert die.inertia is not None
    mass = effective_mass(
        mass=die.mass, centre=die.centre, inertia=die.inertia, point=contact.point,
        direction=contact.direction,
    )  # fmt: skip
    assert mass < 0.9 * die.mass
    assert energy.recoil == pytest.approx(0.001**2 / (2 * mass))
    assert not len(energy.entered)
    assert energy.recoil_sound == pytest.approx(radiated(die, strike, 0.1), rel=1e-3)
    soft = replace(strike, shape="hertz")
    assert struck.energy(die, soft).recoil_sound == pytest.approx(
        radiated(die, soft, 0.1), rel=1e-3
    )


def test_plate_that_once_radiated_more_than_it_got() -> None:
    model = struck.analyze(PLATE, "aluminium", band=(20, 8000), progress=None)
    energy = struck.energy(model, Strike(at="top", impulse=0.005, duration=1e-4))
    contact = model.contact("top")
    drives = model.gains.at(contact.point[None], contact.direction[None])[0, 0]
    # A push that is over at once would give each mode (J phi)^2 / 2; this one gives it less.
    assert np.all(energy.entered <= 1.01 * np.square(0.005 * drives) / 2)
    assert 1e-3 < energy.total["entered"] < 2.5e-3
    assert energy.modes_sound < energy.total["entered"]


def test_law_as_heard_and_a_model_without_air() -> None:
    shape, strike = PLATE, Strike(at="top", impulse=0.01, duration=1e-4)
    options = {"band": (20, 3000), "progress": None}
    heard = struck.energy(struck.analyze(shape, "steel", damping="heard", **options), strike)
    assert "the damping law contains the air" in heard.notes[0]
    losses = heard.material + heard.surface + heard.sound
    np.testing.assert_allclose(losses, heard.entered)
    assert 0 < heard.total["sound"] < heard.total["entered"]
    without = struck.analyze(shape, "steel", air=False, **options)
    energy = struck.energy(without, strike)
    assert "leave the air out" in energy.notes[0]
    assert not energy.sound.any()
    assert energy.total["radiated"] > 0
    law = struck.InternalFriction(loss_tangent=0.001, external=2.0)
    held = struck.energy(without.damped(law), strike)
    fractions = 2.0 / without.damped(law).decays
    np.testing.assert_allclose(held.support, held.entered * fractions, rtol=1e-9)


def test_modes_without_losses_keep_their_energy() -> None:
    perfect = Material(density=7850.0, youngs_modulus=2e11, poisson_ratio=0.29)
    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), perfect, air=False)
    energy = struck.energy(bar, Strike(at="end", impulse=0.01, duration=1e-4))
    assert energy.total["entered"] > 0
    assert not energy.material.any()
    assert any("without losses keep what entered" in note for note in energy.notes)
    assert np.isinf(energy.radiated).any()


def test_modes_without_losses_keep_what_any_force_brings() -> None:
    bar = Bar(length=0.3, width=0.03, thickness=0.005)
    lossless = Material.named("steel").damped(struck.InternalFriction(loss_tangent=0.0))
    model = struck.analyze(bar, lossless, band=(20, 8000), air=False)
    for action in (Pluck(), Strike(impulse=0.01), Strike(impulse=0.01, duration=1e-4)):
        energy = struck.energy(model, action)
        assert np.isposinf(energy.radiated[energy.entered > 0]).all()
        assert (energy.entered > 0).any()


def test_forces_end_with_the_seconds_whatever_else_touches_the_body() -> None:
    model = model_of("bar", "oak")
    strike = Strike(impulse=0.01, duration=0.01)
    cut = struck.energy(model, strike, seconds=0.001)
    held = struck.energy(model, [strike, Hold(time=0.5, seconds=1e-5)], seconds=0.001)
    np.testing.assert_allclose(cut.entered, held.entered)
    assert cut.entered.sum() > 3 * struck.energy(model, strike).entered.sum()


def test_energies_are_of_the_air_that_the_gains_are_for() -> None:
    model = model_of("plate", "abs")
    gains = model.gains
    assert isinstance(gains, ShapeGains)
    assert model.geometry is not None
    energies = []
    for air in (AIR, Air.at(pressure=3e5)):
        air_gains = ShapeGains.radiating(
            model.geometry,
            gains.shapes,
            model.natural_frequencies,
            gains.centre,
            RadiatedPower(air=air),
        )
        changed = replace(model, gains=air_gains, air=False)
        energies.append(struck.energy(changed, Strike(impulse=0.01, duration=1e-4)))
    thin, dense = energies
    ratio = dense.radiated.sum() / thin.radiated.sum()
    assert ratio == pytest.approx(3, rel=0.03)
    assert dense.modes_sound / thin.modes_sound == pytest.approx(ratio, rel=0.01)


def test_notes_of_what_energies_leave_out() -> None:
    bar = Bar(length=0.3, width=0.03, thickness=0.005)
    empty = struck.analyze(bar, "steel", band=(20, 60))
    assert not len(empty.decays)
    assert not any("air" in note for note in struck.energy(empty, Strike(impulse=0.01)).notes)
    plate = RectangularPlate(length=0.2, width=0.15, thickness=0.002)
    wet = struck.analyze(plate, "aluminium", band=(20, 1500), immersed=np.inf)
    notes = struck.energy(wet, Strike(impulse=0.01)).notes
    assert any("leaves out the mass of the water" in note for note in notes)


def test_impossible_balances_are_refused() -> None:
    bar = Bar(length=0.3, width=0.03, thickness=0.005)
    papers = struck.analyze(bar, "steel", radiation="obrien2002")
    recorded = ModalModel(
        frequencies=np.array([400.0]),
        natural_frequencies=np.array([400.0]),
        decays=np.ones(1),
        gains=SinglePoint(outputs=np.ones(1, np.complex128)),
        coordinates=(),
        complete_to=0.0,
    )
    with pytest.raises(OptionError, match="its gains are relative: analyze a body"):
        struck.energy(papers, Strike())
    with pytest.raises(OptionError, match="its gains are of recordings"):
        struck.energy(recorded, Strike())
    with pytest.raises(OptionError, match="nothing pushes the body"):
        struck.energy(model_of("bar", "oak"), Hold())
    with pytest.raises(OptionError, match="seconds"):
        struck.energy(model_of("bar", "oak"), Strike(), seconds=0.0)


def test_modes_above_half_the_rate_get_nothing() -> None:
    model = model_of("bar", "oak")
    energy = struck.energy(model, Strike(at="end", impulse=0.01, duration=1e-4), sample_rate=8000)
    high = model.frequencies >= 4000
    assert high.any()
    assert not energy.entered[high].any()
    assert energy.notes[-1] == f"{high.sum()} modes at or above 4000 Hz left out"


def test_balance_as_text_and_in_third_octaves() -> None:
    energy = struck.energy(model_of("plate", "abs"), Strike(striker="wood", speed=1.0))
    text = str(energy)
    assert "striker                 0.0075 J" in text
    assert f"({100 * energy.total['sound'] / energy.total['entered']:.1f} %)" in text
    assert "radiate less" in text
    assert "<table>" in energy._repr_html_()
    bands = energy.bands
    assert sum(bands.columns["radiated (J)"]) == pytest.approx(energy.total["radiated"])
    assert bands.columns["modes"].sum() == len(energy.frequencies)


def test_render_notes_more_energy_than_the_striker_had() -> None:
    plate = model_of("plate", "abs")
    strike = Strike(striker="steel", speed=1.0)
    energy = struck.energy(plate, strike)
    assert energy.striker is not None
    ratio = (energy.total["entered"] + energy.recoil) / energy.striker
    (note,) = [
        note
        for note in struck.render(plate, strike, seconds=0.1, fade=0).notes
        if "striker's energy" in note
    ]
    assert f"up to {ratio:.2g} times the striker's energy in the modes and the motion" in note
