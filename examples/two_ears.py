"""Compare interaural delays and levels of KEMAR with those of a rigid sphere."""

import numpy as np
from matplotlib.figure import Figure

from struck.ears.heads import Head, SphereHead
from struck.ears.measured_head import MeasuredHead
from struck.ears.sphere import HEAD_RADIUS
from struck.model.material import AIR

RATE, DISTANCE = 48_000, 1.4
AZIMUTHS = np.arange(181)
ANGLES = np.radians(AZIMUTHS)
DIRECTIONS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES])
DISTANCES = np.full(len(ANGLES), DISTANCE)


def left_over_right(head: Head, frequency: float) -> np.ndarray:
    """Return the ratio of the pressures at the left and the right ear."""
    delays, responses = head.prepared(RATE).toward(DIRECTIONS, DISTANCES)
    times = delays[..., np.newaxis] + np.arange(responses.shape[-1]) / RATE
    left, right = np.sum(responses * np.exp(-2j * np.pi * frequency * times), axis=-1).T
    return left / right


def phase_delay(head: Head, frequency: float = 500) -> np.ndarray:
    """Return the interaural phase delay, microseconds; positive if the left ear leads."""
    return 1e6 * np.angle(left_over_right(head, frequency)) / (2 * np.pi * frequency)


def onset_delay(head: Head) -> np.ndarray:
    """Return the interaural delay of the wave front, microseconds; positive if the left leads."""
    delays, _ = head.prepared(RATE).toward(DIRECTIONS, DISTANCES)
    return 1e6 * (delays[:, 1] - delays[:, 0])


def level(head: Head, frequency: float) -> np.ndarray:
    """Return the interaural level difference, dB; positive if the left ear is louder."""
    return 20 * np.log10(np.abs(left_over_right(head, frequency)))


kemar, ball = MeasuredHead.named("kemar"), SphereHead()
SINES = np.sin(ANGLES)
woodworth = 1e6 * HEAD_RADIUS / AIR.sound_speed * (SINES + np.arcsin(SINES))  # 1938

figure = Figure(figsize=(11, 4.4), dpi=120, layout="constrained", facecolor="white")
delays, levels = figure.subplots(1, 2)
delays.plot(AZIMUTHS, phase_delay(kemar), "-", color="#20558a", label="KEMAR, phase at 500 Hz")
delays.plot(AZIMUTHS, phase_delay(ball), "-", color="#c0504d", label="rigid ball, phase at 500 Hz")
delays.plot(AZIMUTHS, onset_delay(kemar), "--", color="#20558a", label="KEMAR, onset")
delays.plot(AZIMUTHS, woodworth, "--", color="#c0504d", label="rigid ball, onset (Woodworth)")
delays.set(title="How much earlier it is at the left ear", ylabel="interaural delay (µs)")
for frequency, line in ((1000, "-"), (4000, "--")):
    for head, name, ink in ((kemar, "KEMAR", "#20558a"), (ball, "rigid ball", "#c0504d")):
        label = f"{name}, {frequency // 1000} kHz"
        levels.plot(AZIMUTHS, level(head, frequency), line, color=ink, label=label)
levels.set(title="How much louder it is at the left ear", ylabel="interaural level difference (dB)")
for axes, top in ((delays, 850), (levels, 21)):
    axes.set(xlabel="azimuth of the source (degrees to the left)", xlim=(0, 180), ylim=(0, top))
    axes.set_xticks(range(0, 181, 30))
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
levels.set_yticks(range(0, 21, 5))
delays.legend(frameon=False, fontsize=9, loc="lower center")
levels.legend(frameon=False, fontsize=9, loc="upper right", ncols=2)
figure.savefig("ears.png")

print("          delay at 500 Hz    delay of onsets   level at 4 kHz")
print("azimuth   KEMAR  ball (us)   KEMAR  ball (us)  KEMAR  ball (dB)")
columns = (phase_delay(kemar), phase_delay(ball), onset_delay(kemar), woodworth)
columns += (level(kemar, 4000), level(ball, 4000))
for azimuth in range(15, 91, 15):
    row = [values[azimuth] for values in columns]
    print("{:7}   {:5.0f} {:5.0f}        {:5.0f} {:5.0f}     {:7.1f} {:5.1f}".format(azimuth, *row))
assert abs(row[0] - row[1]) < 40  # the head of KEMAR has about this size
