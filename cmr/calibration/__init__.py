"""Find the model parameters that reproduce the real robot's path.

`calibrate(recording)` does it, `coverage` decides when a drive is sufficient, and `calibrator` combines the two for
live use. Source of the method: Edwards, Gaskell and Olson, AAMAS 2018, section 2: grid search with numerical
integration that minimises the Euclidean distance between real and simulated path at every time step.
"""

from cmr.calibration.calibrate import calibrate
from cmr.calibration.result import CalibrationResult
from cmr.estimation.estimates import Estimate, EstimationError

__all__ = ["CalibrationResult", "Estimate", "EstimationError", "calibrate"]
