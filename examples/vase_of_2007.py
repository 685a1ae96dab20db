"""A recorded vase is scraped while one walks round it (2007): python examples/vase_of_2007.py full.

Corbett, van den Doel, Lloyd and Heidrich (2007) struck a vase at 3 heights and recorded it at 19
places. Here a synthetic vase stands in for it. Without the word full its takes are short and few
modes ring in them, and all is done in seconds.
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
MODES, HIGHEST = (25, 8000) if FULL else (8, 5000)  # of the vase, and Hz
LEAD, RINGING = (0.3, 0.8) if FULL else (0.06, 0.2)  # s of a take before and after the hit
HEIGHT, RADIUS = 0.30, 0.2  # m, of the vase, and of a ball that holds it and the nearest listener
SECONDS = 3.0  # of the scrape; then it rings out

chance = np.random.default_rng(2007)

# The vase: each mode is a wave over the height times a pattern around it.
frequencies = np.geomspace(400, HIGHEST, MODES) * np.exp(chance.normal(0, 0.04, MODES))
poles = -(6 + 4e-7 * frequencies**2) + 2j * np.pi * frequencies
waves = chance.uniform(0.3, 1.6, MODES)
pattern = chance.normal(size=(5, MODES)) + 1j * chance.normal(size=(5, MODES))
pattern *= np.array([0.3, 0.5, 1, 1, 1])[:, None] * (frequencies / 400) ** 0.7  # high ones are loud


def outputs(places: np.ndarray) -> np.ndarray:
    """Return what arrives at places (L, 3) of each mode (L, M)."""
    x, y, z = (places / np.linalg.norm(places, axis=1)[:, None]).T
    around = np.stack([np.ones_like(x), z, x, x * z, x**2 - y**2], axis=1) @ pattern
    return around / np.linalg.norm(places, axis=1)[:, None]


def recorded(height: float, place: np.ndarray) -> np.ndarray:
    """Return one take: noise alone, then the hit, when it has come to the microphone."""
    gains = np.cos(np.pi * waves * (1 - height)) * outputs(place[None])[0]
    way = np.linalg.norm(place) / AIR.sound_speed
    times = np.arange(round((LEAD + RINGING) * RATE)) / RATE - LEAD - way
    sound = np.imag(np.exp(np.outer(np.maximum(times, 0), poles)) @ gains) * (times >= 0)
    return sound + 0.01 * chance.standard_normal(len(sound))


azimuths = np.array([0, np.pi / 2, np.pi, -np.pi / 2])
half = np.concatenate(
    [[[0, 0, 1]], *(from_spherical(1.0, azimuths, polar) for polar in (np.pi / 4, np.pi / 2))]
)
listeners = np.concatenate([0.5 * half, half, [[0, 0, 0.12]]])  # 9 near, 9 far, one in its mouth
pairs = [(height, place) for height in (1.0, 0.5, 0.0) for place in listeners]
sounds = [recorded(height, place) for height, place in pairs]
loudest = 1.1 * max(np.abs(sound).max() for sound in sounds)

vase = struck.fit(
    [Take(samples=sound / loudest, sample_rate=RATE) for sound in sounds],
    contacts=[height for height, _ in pairs],
    listeners=[place for _, place in pairs],
    symmetry="axial",
    radius=RADIUS,
    modes=MODES,
    pitch=HEIGHT,  # a height goes from 0 to 1
)
struck.save(vase, "vase.struck")
off = np.abs(vase.frequencies[:, None] - np.sort(frequencies)).min(axis=1).max()
print(f"{len(pairs)} takes, {len(vase.frequencies)} modes, off by {1000 * off:.2g} mHz at most")

# A haptic device says a hundred times a second where it is; its last word lets go.
times = np.arange(0, SECONDS, 0.01)
forces = 2 + 0.5 * np.sin(2 * np.pi * 0.7 * times)
forces[-1] = 0
hand = TouchLog(
    times=times,
    points=np.linspace(0.02, 0.98, len(times))[:, None],
    forces=forces,
    speeds=HEIGHT * 0.96 / SECONDS,
)
turns = np.linspace(0, 2 * np.pi, 200)
walk = from_spherical(0.7, turns, np.full(200, 1.2))
heard, notes = {}, ()
for name, place in {"walking": (np.linspace(0, SECONDS, 200), walk), "standing": walk[0]}.items():
    listener = Mono(position=place)
    sound = struck.render(vase, hand, listener=listener, seconds=SECONDS + 1, sample_rate=RATE)
    sound.save(f"vase_{name}.wav")
    spectrogram(sound).savefig(f"vase_{name}.png")
    parts = sound.samples[0, : round(SECONDS * RATE)].reshape(15, -1)
    notes = sound.notes
    heard[name] = 10 * np.log10(np.square(parts).mean(axis=1))
for note in notes:
    print("note:", note)
for name, levels in heard.items():
    print(
        f"{name:9}" + " ".join(f"{level - heard['standing'][0]:5.1f}" for level in levels) + " dB"
    )
change = heard["walking"] - heard["standing"]
print(f"walking differs from standing still by {change.min():.1f} to {change.max():.1f} dB")
assert off < 0.1
assert np.ptp(change) > 3
