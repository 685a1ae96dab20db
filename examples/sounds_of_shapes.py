"""Compare the timbre of a bar and of a drum between contacts (1998, section 2.2)."""

import struck
from struck.shapes import Bar, CircularMembrane

bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005, ends="clamped"), "steel")
drum = struck.analyze(
    CircularMembrane(radius=0.165, thickness=2.5e-4, tension=3000.0), "nylon", band=(20, 2000)
)
places = {bar: [(0.02,), (0.075,), (0.15,)], drum: [(0.15, 0.0), (0.08, 0.0), (0.0, 0.0)]}

for name, model in {"bar": bar, "drum": drum}.items():
    print(f"{name}: {len(model.frequencies)} modes, the lowest at {model.frequencies[0]:.1f} Hz")
    for place in places[model]:
        strike = struck.Strike(at=place, striker="wood", speed=1.0)
        sound = struck.render(model, strike, seconds=1.0)
        sound.save(f"{name}_{place[0]:g}.wav")
        distance = struck.sonic_distance(model, model, at=places[model][0], against=place)
        print(f"  struck at {place}: {distance:.1f} dB from the first")
