"""A struck body, from the model to what a listener hears."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp
from scipy.signal import oaconvolve

from struck.analysis.analysis import analyze, model_of_modes
from struck.ears import Stereo
from struck.errors import ContactError, OptionError
from struck.excitation.hertz import Striker
from struck.excitation.strike import Strike
from struck.files.sound import Sound
from struck.model.damping import Rayleigh
from struck.model.gains import ShapeGains
from struck.model.material import Material
from struck.model.model import ModalModel
from struck.scene.render import LONGEST_RING, SHORTEST_RING, render
from struck.shapes import Bar

GLASS = Material(
    name="test glass",
    density=2500.0,
    youngs_modulus=70e9,
    poisson_ratio=0.22,
    damping=Rayleigh(mass=2.0, stiffness=2e-8),
)
FREQUENCIES = np.array(
    [211.3, 480.7, 701.2, 1033.9, 1500.1, 1710.4, 2222.2, 2904.6, 3340.0, 4102.5, 5001.7, 6300.3]
)
TOP = (0.02, 0.01, 0.05)


class Loud:
    """Radiation that hears modal velocity as it is, a little less of each higher mode."""

    name = "test"
    calibrated = True
    references = ()

    def coefficients(
        self, surface: object, shapes: np.ndarray, frequencies: np.ndarray, centre: object
    ) -> np.ndarray:
        del surface, shapes, centre
        return 1 / (1 + frequencies / 3000)


def block(frequencies: np.ndarray = FREQUENCIES, material: Material = GLASS) -> ModalModel:
    """Make a block of 0.2 x 0.1 x 0.1 m with smooth, made-up mode shapes."""
    mesh = trimesh.creation.box((0.2, 0.1, 0.1)).subdivide().subdivide()
    random = np.random.default_rng(7)
    waves = random.normal(size=(3, 3, len(frequencies))) * 15
    shapes = np.sin(np.einsum("vd,dem->vem", mesh.vertices, waves) + random.normal(size=3)[:, None])
    mass = 2500 * 0.2 * 0.1 * 0.1
    return model_of_modes(
        mesh.vertices,
        mesh.faces,
        frequencies,
        shapes / np.sqrt(mass),
        material=material,
        mass=mass,
        centre=np.zeros(3),
        inertia=np.diag([0.02, 0.05, 0.05]) * mass / 12,
        radiation=Loud(),
        places={"top": np.array(TOP)},
    )


BLOCK = block()


def peaks(sound: Sound, count: int) -> np.ndarray:
    """Return the frequencies of the strongest spectral peaks, by parabolas through log levels."""
    samples = sound.samples[0].astype(float)
    levels = np.log(np.abs(np.fft.rfft(samples)))
    inner = levels[1:-1]
    tops = np.flatnonzero((inner > levels[:-2]) & (inner >= levels[2:])) + 1
    tops = tops[np.argsort(levels[tops])[::-1][:count]]
    below, here, above = levels[tops - 1], levels[tops], levels[tops + 1]
    shift = (below - above) / (2 * (below - 2 * here + above))
    return (tops + shift) * sound.sample_rate / len(samples)


def decay_at(sound: Sound, frequency: float) -> float:
    """Return the decay rate of what is left after shifting a mode to 0 Hz and smoothing."""
    times = np.arange(sound.samples.shape[1]) / sound.sample_rate
    window = np.blackman(sound.sample_rate // 12)
    moved = sound.samples[0] * np.exp(-2j * np.pi * frequency * times)
    smooth = np.abs(oaconvolve(moved, window, mode="valid"))
    middle = np.arange(len(smooth)) / sound.sample_rate
    kept = (middle > 0.05) & (smooth > smooth.max() * 10 ** (-40 / 20))
    return -np.polyfit(middle[kept], np.log(smooth[kept]), 1)[0]


def test_the_ten_strongest_peaks_are_modes_that_decay_as_the_model_says() -> None:
    sound = render(BLOCK, Strike(at=TOP, striker="steel", speed=1.0))
    found = peaks(sound, 10)
    modes = np.abs(BLOCK.frequencies - found[:, None]).argmin(axis=1)
    assert len(set(modes)) == 10
    for mode, peak in zip(modes, found, strict=True):
        assert abs(BLOCK.frequencies[mode] - peak) < 0.1
        assert decay_at(sound, peak) == pytest.approx(BLOCK.decays[mode], rel=0.02)


def test_a_strike_solves_the_equation_of_motion_of_each_mode() -> None:
    """Integrate q'' + 2 d q' + (2 pi f0)^2 q = drive * force and hear the inertia q'' + 2 d q'.

    In free motion that is -(2 pi f0)^2 q, so the scale makes it output * 2 pi f q.
    """
    strike = Strike(at=TOP, impulse=0.02, duration=3e-4, time=1e-4)
    listener = np.array([0.0, 0.0, 2.0])
    contact = BLOCK.contact(TOP)
    drive = BLOCK.gains.at(contact.point[None], contact.direction[None])[0, 0]
    output = BLOCK.gains.toward(listener[None])[0, 0].real * 2 * np.pi * BLOCK.frequencies

    def motion(time: float, state: np.ndarray) -> np.ndarray:
        place, speed = np.split(state, 2)
        phase = (time - 1e-4) / 3e-4
        force = 0.02 * np.pi / 6e-4 * np.sin(np.pi * phase) if 0 <= phase <= 1 else 0.0
        stiffness = np.square(2 * np.pi * BLOCK.natural_frequencies)
        push = drive * force - 2 * BLOCK.decays * speed - stiffness * place
        return np.concatenate([speed, push])

    times = np.arange(480) / 48000
    still = np.zeros(2 * len(drive))
    answer = solve_ivp(
        motion, (0, times[-1]), still, "DOP853", times, rtol=1e-9, atol=1e-15, max_step=2e-5
    )
    phases = (times - 1e-4) / 3e-4
    inside = (phases >= 0) & (phases <= 1)
    force = 0.02 * np.pi / 6e-4 * np.where(inside, np.sin(np.pi * phases), 0.0)
    squares = np.square(2 * np.pi * BLOCK.natural_frequencies)[:, None]
    inertia = drive[:, None] * force - squares * answer.y[: len(drive)]
    expected = -output @ (inertia / squares)
    sound = render(BLOCK, strike, seconds=0.01, fade=0, listener=listener)
    np.testing.assert_allclose(sound.samples[0], expected, atol=1e-6 * np.abs(expected).max())


def test_strikers_that_bring_less_energy_than_they_leave_are_told() -> None:
    """On a body that is held one mode takes (J phi)^2 / 2 of an impulse that is over at once."""
    bar = analyze(
        Bar(length=0.3, width=0.02, thickness=0.004, ends="clamped"), "steel", band=(20, 900)
    )
    blow = Strike(at="middle", striker="steel", speed=1.0, duration=1e-6)
    steel = Striker.named("steel")
    drive = bar.gains.at(*(np.array([each]) for each in ((0.15, 0.0, 0.002), (0, 0, -1.0))))[0, 0]
    impulse = steel.mass * (1 + steel.restitution)
    share = np.sum((impulse * drive) ** 2) / steel.mass
    (note,) = [n for n in render(bar, blow, seconds=0.1, fade=0).notes if "striker's energy" in n]
    assert f"1 of 1 strikes leave up to {share:.2g} times the striker's energy" in note
    assert f"{10 * np.log10(share):.1f} dB softer" in note
    assert not render(bar, Strike(at="middle", striker="felt"), seconds=0.1, fade=0).notes


def test_half_the_distance_doubles_the_pressure() -> None:
    strike = Strike(at=TOP, impulse=0.02)
    far, near = (
        render(BLOCK, strike, seconds=0.2, fade=0, listener=(0, distance, 0)).samples
        for distance in (2.0, 1.0)
    )
    np.testing.assert_allclose(near, 2 * far, rtol=1e-6)


def test_strikes_superpose() -> None:
    strikes = [
        Strike(at=TOP, impulse=0.02, striker="wood"),
        Strike(at="top", striker="steel", speed=1.0, time=0.10003),
        Strike(at="vertex:3", impulse=0.01, direction=(1, 1, 0), time=0.05),
    ]
    together = render(BLOCK, strikes, seconds=0.4, fade=0).samples
    apart = sum(
        render(BLOCK, strike, seconds=0.4, fade=0).samples.astype(float) for strike in strikes
    )
    np.testing.assert_allclose(together, apart, atol=2e-7 * np.abs(apart).max())


def test_an_onset_between_samples_delays_every_mode_by_just_that() -> None:
    late = Strike(at=TOP, impulse=0.02, duration=5e-4, time=0.3 / 48000)
    fine = Strike(at=TOP, impulse=0.02, duration=5e-4, time=3 / 480000)
    coarse = render(BLOCK, late, seconds=0.1, fade=0).samples[0]
    dense = render(BLOCK, fine, seconds=0.1, fade=0, sample_rate=480000).samples[0, ::10]
    np.testing.assert_allclose(coarse, dense, atol=1e-6 * np.abs(dense).max())
    assert np.abs(
        coarse - render(BLOCK, replace(late, time=0.0), seconds=0.1, fade=0).samples[0]
    ).max() > (0.01 * np.abs(dense).max())


def test_pressure_goes_with_the_impulse() -> None:
    soft, hard = (
        render(BLOCK, Strike(impulse=impulse, duration=1e-4), seconds=0.1, fade=0).samples
        for impulse in (0.01, 0.03)
    )
    np.testing.assert_allclose(hard, 3 * soft, rtol=1e-6, atol=1e-9)


def test_softer_strikers_sound_darker() -> None:
    shares = []
    for striker in ("fingertip", "rubber", "wood", "steel"):
        sound = render(BLOCK, Strike(at=TOP, impulse=0.01, striker=striker), seconds=1.0, fade=0)
        frequencies, values = sound.spectrum()
        energy = np.square(values[0])
        shares.append(energy[frequencies > 2000].sum() / energy.sum())
    assert shares == sorted(shares)
    assert shares[0] < 1e-3
    assert shares[-1] > 0.01


def test_modes_above_half_the_sample_rate_are_left_out_and_counted() -> None:
    strike = Strike(at=TOP, impulse=0.02)
    low = render(BLOCK, strike, seconds=0.5, fade=0, sample_rate=6000)
    assert low.notes == ("4 of 12 modes lie at or above 3000 Hz and were left out",)
    assert peaks(low, 1)[0] < 3000
    assert render(BLOCK, strike, seconds=0.1, fade=0).notes == ()


def test_a_body_that_samples_cannot_carry_is_silent() -> None:
    sound = render(BLOCK, Strike(at=TOP, impulse=0.02), sample_rate=400)
    assert sound.duration == pytest.approx(SHORTEST_RING)
    assert sound.peak == 0
    assert sound.notes == ("12 of 12 modes lie at or above 200 Hz and were left out",)


def test_a_sound_of_unsaid_length_falls_by_60_decibels() -> None:
    sound = render(BLOCK, Strike(at=TOP, impulse=0.02, time=0.25))
    slowest = BLOCK.decays.min()
    assert sound.duration == pytest.approx(0.25 + np.log(1000) / slowest, abs=0.01)
    tail = np.abs(sound.samples[0, -2000:]).max()
    assert tail < 10 ** (-50 / 20) * sound.peak


def test_an_endless_sound_is_cut_and_says_so() -> None:
    endless = block(material=replace(GLASS, damping=Rayleigh(mass=0.0, stiffness=0.0)))
    sound = render(endless, Strike(at=TOP, impulse=0.02), sample_rate=16000)
    assert sound.duration == LONGEST_RING
    assert "10 s after the last strike" in sound.notes[0]


def test_a_contact_beside_the_surface_says_how_far_it_was_moved() -> None:
    sound = render(BLOCK, Strike(at=(0.02, 0.01, 0.052), impulse=0.02), seconds=0.1, fade=0)
    assert sound.notes == ("a contact was moved 0.002 m to the surface",)


def test_the_listener_stands_a_metre_away_or_two_radii() -> None:
    strike = Strike(at=TOP, impulse=0.02)
    left_out = render(BLOCK, strike, seconds=0.1, fade=0).samples
    np.testing.assert_array_equal(
        left_out, render(BLOCK, strike, seconds=0.1, fade=0, listener=(1, 0, 0)).samples
    )
    large = BLOCK.scaled(10.0)
    radius = np.linalg.norm([1.0, 0.5, 0.5])
    strike = Strike(at="top", impulse=0.02)
    np.testing.assert_array_equal(
        render(large, strike, seconds=0.1, fade=0).samples,
        render(large, strike, seconds=0.1, fade=0, listener=(2 * radius, 0, 0)).samples,
    )


def test_a_sound_is_calibrated_where_its_model_is() -> None:
    assert render(BLOCK, Strike(impulse=0.02), seconds=0.1, fade=0).calibrated


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seconds": 0.0}, r"seconds is 0\.0"),
        ({"seconds": np.nan}, "seconds is nan"),
        ({"seconds": 1e9}, "at most 3600"),
        ({"sample_rate": 0}, "sample_rate is 0"),
        ({"sample_rate": 44100.5}, "whole number"),
        ({"listener": (1, 2)}, "one position"),
        ({"listener": (1, 2, np.inf)}, "one position"),
        ({"excitations": []}, "at least one strike"),
        ({"excitations": [0.3]}, r"0\.3 is no excitation"),
        ({"excitations": Strike}, r"Strike is a class: give Strike\(...\)"),
        ({"listener": Stereo}, r"Stereo is a class: give Stereo\(...\)"),
    ],
)
def test_impossible_requests_are_refused(arguments: dict[str, object], message: str) -> None:
    complete = {"excitations": Strike(impulse=0.02)} | arguments
    with pytest.raises(OptionError, match=message):
        render(BLOCK, complete.pop("excitations"), **complete)


def test_contacts_and_listeners_in_the_wrong_place_are_refused() -> None:
    with pytest.raises(ContactError, match="off the body"):
        render(BLOCK, Strike(at=(1, 1, 1), impulse=0.02))
    with pytest.raises(ContactError, match="inside"):
        render(BLOCK, Strike(at=TOP, impulse=0.02), listener=(0.05, 0, 0))


class Broken(ShapeGains):
    """Gains of which two modes are not heard as numbers."""

    def toward(self, listeners: np.ndarray) -> np.ndarray:
        outputs = super().toward(listeners)
        outputs[..., [2, 5]] = np.nan
        return outputs


def test_gains_that_are_not_finite_are_refused() -> None:
    given = {each.name: getattr(BLOCK.gains, each.name) for each in fields(BLOCK.gains)}
    with pytest.raises(OptionError, match="2 of 12 modes"):
        render(replace(BLOCK, gains=Broken(**given)), Strike(at=TOP, impulse=0.02))
