from .analysis import model_of_modes as model_of_modes
