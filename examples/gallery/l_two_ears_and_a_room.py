"""
Two ears and a room
===================

Place listeners with two ears, and a room around them: `Binaural`, `Stereo` and `Room`.
"""

import struck
from struck import Binaural, Room, Strike
from struck.report.charts import spectrogram
from struck.shapes import Bar

bar = struck.analyze(Bar(length=0.25, width=0.03, thickness=0.006, ends="free"), "aluminium")
taps = [Strike(at="end", striker="wood", speed=1.0, time=0.5 * n) for n in range(4)]
walking = Binaural(position=([0, 2], [(-3, 1, 0), (3, 1, 0)]), facing=(1, 0, 0))
struck.render(bar, taps, seconds=2.5, listener=walking)

# %%
# The same sound in a room of 6 m by 5 m by 3 m with brick walls.
room = Room(size=(6.0, 5.0, 3.0), walls="brick", corner=(-3.5, -2.0, -1.2))
listener = Binaural(position=(1.0, 1.0, 0.0), facing=(-1, -1, 0))
sound = struck.render(bar, taps, seconds=3.0, listener=listener, room=room)
sound

# %%
# Its spectrogram.
spectrogram(sound)
