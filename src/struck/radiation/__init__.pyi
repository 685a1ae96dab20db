from .fluid_loading import add_air_mass as add_air_mass
from .fluid_loading import fill as fill
from .fluid_loading import immerse as immerse
from .radiated_power import Heuristic1998 as Heuristic1998
from .radiated_power import ObrienCoupling as ObrienCoupling
from .radiated_power import RadiatedPower as RadiatedPower
from .radiated_power import by_name as by_name
