from .analysis import model_of_modes as model_of_modes
from .tuning import tune as tune
