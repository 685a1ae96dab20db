"""
Other materials and sizes
=========================

One analysis serves for many bodies: another isotropic material, size or damping is arithmetic.
"""

import struck
from struck import InternalFriction, Strike
from struck.shapes import Bar

bar = struck.analyze(Bar(length=0.2, width=0.03, thickness=0.006, ends="free"), "steel")
struck.show(bar)

# %%
# As it is, in steel.
strike = Strike(at="end", striker="wood", speed=0.5)
struck.render(bar, strike, seconds=1.0)

# %%
# In glass, and in oak.
struck.render(bar.made_of("glass"), strike, seconds=1.0)

# %%
struck.render(bar.made_of("oak"), strike, seconds=1.0)

# %%
# Twice as large it sounds an octave lower; `tuned` finds the size for a note.
struck.render(bar.scaled(2.0), strike, seconds=1.0)

# %%
# A hand takes 20 1/s from every mode.
held = bar.damped(InternalFriction(loss_tangent=3e-4, external=20.0))
print(f"T60 of the lowest mode: {bar.t60[0]:.1f} s free, {held.t60[0]:.2f} s held")
struck.render(held, strike, seconds=1.0)
