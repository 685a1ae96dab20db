"""
Sound map and sonic distance
============================

Choose the contacts whose sounds represent a surface: `struck.sound_map`, `struck.sonic_distance`
and `struck.audible`.
"""

import struck
from struck.report import sound_map_picture
from struck.shapes import RectangularPlate

shape = RectangularPlate(length=0.30, width=0.20, thickness=0.003, edges="clamped")
plate = struck.analyze(shape, "steel", band=(20, 4000))
made = struck.sound_map(plate, 6.0)
print(f"{len(made.contacts)} stored contacts: no place is more than 6 dB from its own")
sound_map_picture(made)

# %%
# The difference between two contacts, in dB, and the number of audible modes.
centre, corner = (0.15, 0.10), (0.03, 0.03)
print(f"{struck.sonic_distance(plate, plate, at=centre, against=corner):.1f} dB apart")
print(f"{len(struck.audible(plate).frequencies)} of {len(plate.frequencies)} modes are audible")

# %%
# Strikes at the centre, then near the corner.
taps = [struck.Strike(at=centre), struck.Strike(at=corner, time=0.7)]
struck.render(plate, taps, seconds=1.5)
