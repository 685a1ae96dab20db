"""
Roll
====

Roll a ball over a surface; both are rough: `Roll`.
"""

import struck
from struck import Roll
from struck.report.charts import spectrogram
from struck.solids import Block

block = Block(size=(0.30, 0.20, 0.003))
plate = struck.analyze(block, "steel", accuracy="preview", band=(20, 10_000))
path = [(-0.12, -0.06, 0.0015), (0.12, 0.06, 0.0015)]
ball = Roll(path=path, radius=0.012, speed=0.2, mass=0.02)
sound = struck.render(plate, ball, seconds=1.5)
spectrogram(sound)

# %%
sound

# %%
# A worn flat on the ball is audible once per revolution.
struck.render(plate, Roll(path=path, radius=0.012, speed=0.2, mass=0.02, flat=2e-6), seconds=1.5)
