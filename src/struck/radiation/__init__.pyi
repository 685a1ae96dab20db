from .radiated_power import Heuristic1998 as Heuristic1998
from .radiated_power import ObrienCoupling as ObrienCoupling
from .radiated_power import RadiatedPower as RadiatedPower
from .radiated_power import by_name as by_name
