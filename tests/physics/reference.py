"""Numbers from elsewhere: what the tests of physics are measured against.

None was computed with this package. Each came from print and was then confirmed by another
method (characteristic equations to 25 digits, Ritz's method in three dimensions), or where it is
said so the other way round.
"""

from __future__ import annotations

from typing import NamedTuple

# O'Brien, Shen & Gatchalian 2002, Table 1, chime: Lame's constants in Pa, kg/m^3.
CHIME_LAME, CHIME_DENSITY, CHIME_STIFFNESS_DAMPING = (4.98e10, 2.57e10), 2700.0, 1e-7
# Section 4: 1.25 cm in radius, nominal wall 1 mm.
CHIME_RADIUS, CHIME_WALL = 0.0125, 0.001


class Chime(NamedTuple):
    """A row of Table 2 (m, Hz), then the fundamental by Fourier and Ritz in three dimensions."""

    ideal: float
    length: float
    computed: float
    adjusted_length: float
    adjusted: float
    elastic: float


# Named as printed; by today's count of octaves 587.33 Hz is D5, 1174.66 Hz D6.
CHIMES = {
    "D3": Chime(587.33, 0.505, 589.17, 0.5061, 587.40, 587.883),
    "E3": Chime(659.26, 0.475, 665.03, 0.4770, 659.27, 663.240),
    "G3": Chime(783.99, 0.435, 787.01, 0.4366, 784.06, 788.365),
    "A4": Chime(880.00, 0.410, 884.70, 0.4115, 879.36, 885.305),
    "B4": Chime(987.77, 0.388, 984.75, 0.3878, 987.32, 986.083),
    "D4": Chime(1174.66, 0.353, 1186.88, 0.3548, 1174.67, 1185.467),
}
# Free tube D3, by waves around (0: torsion and stretching, 1: bending, 2: ovals), Hz.
D3_FAMILIES = {
    0: (3054.66, 4980.11, 6109.33, 9163.99),
    1: (587.88, 1575.12, 2969.53, 4681.10, 6630.65),
    2: (4541.74, 4543.41, 4563.78, 4615.56, 4732.17, 4953.92),
}

# Free elastic sphere, omega R / c_s (Lamb 1882; Eringen & Suhubi 1975, section 8.14), by order n.
TORSIONAL = {
    1: (5.76345919689, 9.09501133048),
    2: (2.50113262041, 7.13600879219),
    3: (3.86469977822, 8.44492202003),
    4: (5.09461563241, 9.71250439543),
    5: (6.26576784527, 10.9506107192),
}
SPHEROIDAL = {  # by Poisson's ratio, then order
    0.25: {
        1: (3.42452973199, 6.77129136738),
        2: (2.6398692779, 4.86527284994),
        3: (3.91633702105, 6.45436925366),
        4: (5.00931286417, 8.06149668377),
    },
    0.3: {
        1: (3.52998730064, 7.10110586604),
        2: (2.64621703487, 5.00695683431),
        3: (3.93740128887, 6.60861760192),
        4: (5.04591533191, 8.21473027971),
    },
}
BREATHING = {0.25: 4.43999821236, 0.3: 4.99551434044}  # spheroidal, n = 0
# Hollow spheres of E = 70 GPa, nu = 0.25, 2700 kg/m^3, R = 50 mm: lowest mode of bending, Hz.
HOLLOW_SPHERE = {0.008: 13439.335, 0.002: 12318.452}

# Free cube, nu = 0.3, omega L / c_s and multiplicity (Demarest 1971; Ohno 1976: their method at
# degree 16). 4.442883 = sqrt(2) pi is exact for any Poisson's ratio.
CUBE = ((2.856047, 2), (3.845972, 3), (3.911251, 3), (4.442883, 3), (4.572781, 3), (4.792565, 3))

# Free square plate, nu = 0.3, omega a^2 sqrt(rho h / D) by Kirchhoff's theory, converged. (Leissa
# 1969 and Barton print upper bounds up to 1 % higher: 13.489, 19.789, 24.432, 35.024.)
SQUARE_PLATE = (13.4682, 19.59614, 24.2702, 34.80089, 34.80089, 61.09323, 61.09323)
# NAFEMS FV12: that plate with a = 10 m, h = 0.05 m, E = 200 GPa, 8000 kg/m^3; Hz.
FV12_PUBLISHED = (1.622, 2.360, 2.922, 4.233, 4.233, 7.416)
FV12_KIRCHHOFF = (1.6217, 2.3595, 2.9223, 4.1903, 4.1903, 7.356)
# Free circular plate, nu = 0.3, omega R^2 sqrt(rho h / D) and nodal diameters.
CIRCULAR_PLATE = ((5.358330, 2), (9.003137, 0), (12.438988, 3), (20.474550, 1))

# Euler and Bernoulli's beams: beta L.
FREE_FREE = (4.730040744862704, 7.853204624095838, 10.995607838001671)
CLAMPED_FREE = (1.8751040687119611, 4.694091132974175, 7.854757438237613)
