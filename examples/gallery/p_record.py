"""
Record point by point
=====================

Record the takes of a plan, and fit a model to them. `struck record` does this with a microphone;
this script strikes a computed bar instead.
"""

from pathlib import Path

import numpy as np

import struck
from struck import Sound, Strike
from struck.recordings import capture, read_plan
from struck.report.charts import spectrogram
from struck.shapes import Bar

bar = struck.analyze(Bar(length=0.25, width=0.03, thickness=0.006, ends="free"), "aluminium")
Path("plan.toml").write_text("""
seconds = 1.0
lead_in = 0.5
hits = 1
coordinates = ["x"]
contacts = [[0.01], [0.09], [0.125]]
""")


class Recorder:
    """A substitute for a microphone, which renders strikes on the bar."""

    sample_rate, channels = 48_000, 1

    def record(self, take, seconds, lead_in, cue):
        """Return the samples of one take, lead-in included."""
        cue()
        place = take.point.contact
        hit = struck.render(bar, Strike(at=place, striker="wood", speed=0.5), seconds=seconds - 0.6)
        samples = np.zeros((1, round(seconds * 48_000)))
        begin = round((lead_in + 0.05) * 48_000)
        samples[0, begin : begin + hit.samples.shape[1]] = 0.1 * hit.samples[0]
        samples += 1e-4 * np.random.default_rng(len(place)).standard_normal(samples.shape)
        return Sound(samples=np.float32(samples), sample_rate=48_000)


outcome = capture(read_plan("plan.toml"), Path("takes"), Recorder())
print(f"{outcome.recorded} takes, {len(outcome.refusals)} refused")

# %%
# The first take: half a second of noise, then the hit.
spectrogram(Sound.load(next(Path("takes").glob("*.wav"))))

# %%
# One model of all takes, which can be struck between the recorded contacts.
model = struck.fit("takes", modes=None)
struck.render(model, Strike(at=(0.05,)), seconds=1.0)
