from .far_field import Heuristic1998 as Heuristic1998
from .far_field import ObrienCoupling as ObrienCoupling
from .far_field import RadiatedPower as RadiatedPower
from .far_field import by_name as by_name
