"""
Scrape
======

Drag a tip along a path over the surface: `Scrape`.
"""

import struck
from struck import Scrape
from struck.report.charts import spectrogram
from struck.solids import Block

block = Block(size=(0.30, 0.20, 0.003))
plate = struck.analyze(block, "steel", accuracy="preview", band=(20, 10_000))
path = [(-0.10, -0.06, 0.0015), (0.11, 0.05, 0.0015)]

slow = Scrape(path=path, speed=0.1, load=2.0, roughness="sandpaper p80", radius=1e-3)
sound = struck.render(plate, slow, seconds=2.0)
spectrogram(sound)

# %%
sound

# %%
# Back and forth over wood, with increasing speed.
faster = Scrape(
    path=path, speed=([0, 2], [0.05, 0.5]), load=1.0, roughness="wood", radius=1e-3, repeat="back"
)
struck.render(plate, faster, seconds=2.0)
