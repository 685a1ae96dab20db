"""Tune six aluminium tubes to the notes of a wind chime and play them one after another.

The chimes of O'Brien et al. 2002, Table 2: tubes of 12.5 mm radius and 1 mm wall.
"""

import numpy as np

import struck
from struck import Sound, Strike
from struck.solids import Tube

NOTES = {"D5": 587.33, "E5": 659.26, "G5": 783.99, "A5": 880.00, "B5": 987.77, "D6": 1174.66}
blank = Tube(length=0.5, radius=0.0125, wall=0.001)

played = []
for name, frequency in NOTES.items():
    tube = struck.tune(blank, "aluminium", vary="length", lowest=frequency, accuracy="preview")
    chime = struck.analyze(
        tube, "aluminium", damping="heard", band=(20, 10_000), accuracy="preview"
    )
    played.append(struck.render(chime, Strike(at="end", striker="wood", speed=1.0), seconds=1.0))
    print(f"{name}: {1000 * tube.length:.1f} mm rings at {chime.frequencies[0]:.2f} Hz")
    assert abs(chime.frequencies[0] - frequency) < 0.1

melody = np.concatenate([sound.samples for sound in played], axis=1)
Sound(samples=melody, sample_rate=48_000, calibrated=True).save("chimes.wav")
