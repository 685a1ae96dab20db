"""
Hold
====

Damp the modes that move at the place of a hand: `Hold`.
"""

import struck
from struck import Hold, Strike
from struck.report.charts import spectrogram
from struck.shapes import CircularPlate

plate = CircularPlate(radius=0.15, thickness=0.002, edge="free")
gong = struck.analyze(plate, "bronze", band=(20, 6000))
blow = Strike(at=(0.14, 0.0), striker="wood", speed=1.0)
sound = struck.render(gong, [blow, Hold(at=(-0.14, 0.0), grip=30.0, time=1.0)], seconds=2.0)
spectrogram(sound)

# %%
sound
