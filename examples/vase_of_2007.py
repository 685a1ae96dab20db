"""Scrape a fitted vase while the listener walks around it: python examples/vase_of_2007.py full.

Corbett, van den Doel, Lloyd and Heidrich (2007) struck a vase at 3 heights and recorded it at 19
positions. This script uses a synthetic vase. Without the argument full the takes are shorter, with
fewer modes, so that the script takes seconds.
"""

import sys

import numpy as np

import struck
from struck import Mono
from struck.excitation import TouchLog
from struck.model.material import AIR
from struck.model.survey import from_spherical
from struck.recordings import Take
from struck.report.charts import spectrogram

FULL = "full" in sys.argv[1:]
RATE = 44_100 if FULL else 22_050
MODES, HIGHEST = (
    (25, 8000) if FULL else (8, 5000)
)  # number of modes, and their highest frequency, Hz
LEAD, RINGING = (0.3, 0.8) if FULL else (0.06, 0.2)  # s of a take before and after the hit
HEIGHT, RADIUS = 0.30, 0.2  # m: the vase; a sphere around vase and nearest listener
SECONDS = 3.0  # s, duration of the scrape

generator = np.random.default_rng(2007)

# The vase: each mode is a wave over the height times a pattern around it.
frequencies = np.geomspace(400, HIGHEST, MODES) * np.exp(generator.normal(0, 0.04, MODES))
poles = -(6 + 4e-7 * frequencies**2) + 2j * np.pi * frequencies
waves = generator.uniform(0.3, 1.6, MODES)
pattern = generator.normal(size=(5, MODES)) + 1j * generator.normal(size=(5, MODES))
pattern *= (
    np.array([0.3, 0.5, 1, 1, 1])[:, None] * (frequencies / 400) ** 0.7
)  # louder at high frequencies


def outputs(places: np.ndarray) -> np.ndarray:
    """Return the output (L, M) of each mode at listener positions (L, 3)."""
    x, y, z = (places / np.linalg.norm(places, axis=1)[:, None]).T
    around = np.stack([np.ones_like(x), z, x, x * z, x**2 - y**2], axis=1) @ pattern
    return around / np.linalg.norm(places, axis=1)[:, None]


def record_take(height: float, place: np.ndarray) -> np.ndarray:
    """Return one take: noise, then the hit after its propagation delay."""
    gains = np.cos(np.pi * waves * (1 - height)) * outputs(place[None])[0]
    delay = np.linalg.norm(place) / AIR.sound_speed
    times = np.arange(round((LEAD + RINGING) * RATE)) / RATE - LEAD - delay
    sound = np.imag(np.exp(np.outer(np.maximum(times, 0), poles)) @ gains) * (times >= 0)
    return sound + 0.01 * generator.standard_normal(len(sound))


azimuths = np.array([0, np.pi / 2, np.pi, -np.pi / 2])
half = np.concatenate(
    [[[0, 0, 1]], *(from_spherical(1.0, azimuths, polar) for polar in (np.pi / 4, np.pi / 2))]
)
listeners = np.concatenate([0.5 * half, half, [[0, 0, 0.12]]])  # 9 near, 9 far, one in the mouth
pairs = [(height, place) for height in (1.0, 0.5, 0.0) for place in listeners]
sounds = [record_take(height, place) for height, place in pairs]
loudest = 1.1 * max(np.abs(sound).max() for sound in sounds)

vase = struck.fit(
    [Take(samples=sound / loudest, sample_rate=RATE) for sound in sounds],
    contacts=[height for height, _ in pairs],
    listeners=[place for _, place in pairs],
    symmetry="axial",
    radius=RADIUS,
    modes=MODES,
    pitch=HEIGHT,  # m; the height coordinate ranges from 0 to 1
)
struck.save(vase, "vase.struck")
off = np.abs(vase.frequencies[:, None] - np.sort(frequencies)).min(axis=1).max()
print(f"{len(pairs)} takes, {len(vase.frequencies)} modes, off by {1000 * off:.2g} mHz at most")

# Positions and forces of a haptic device, 100 times per second; the last force releases.
times = np.arange(0, SECONDS, 0.01)
forces = 2 + 0.5 * np.sin(2 * np.pi * 0.7 * times)
forces[-1] = 0
hand = TouchLog(
    times=times,
    points=np.linspace(0.02, 0.98, len(times))[:, None],
    forces=forces,
    speeds=HEIGHT * 0.96 / SECONDS,
)
angles = np.linspace(0, 2 * np.pi, 200)
walk = from_spherical(0.7, angles, np.full(200, 1.2))
levels_of, notes = {}, ()
for name, place in {"walking": (np.linspace(0, SECONDS, 200), walk), "standing": walk[0]}.items():
    listener = Mono(position=place)
    sound = struck.render(vase, hand, listener=listener, seconds=SECONDS + 1, sample_rate=RATE)
    sound.save(f"vase_{name}.wav")
    spectrogram(sound).savefig(f"vase_{name}.png")
    parts = sound.samples[0, : round(SECONDS * RATE)].reshape(15, -1)
    notes = sound.notes
    levels_of[name] = 10 * np.log10(np.square(parts).mean(axis=1))
for note in notes:
    print("note:", note)
for name, levels in levels_of.items():
    print(
        f"{name:9}"
        + " ".join(f"{level - levels_of['standing'][0]:5.1f}" for level in levels)
        + " dB"
    )
change = levels_of["walking"] - levels_of["standing"]
print(f"walking differs from standing still by {change.min():.1f} to {change.max():.1f} dB")
assert off < 0.1
assert np.ptp(change) > 3
