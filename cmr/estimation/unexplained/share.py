"""The predicted share of a signal's prediction errors, in the signal's unit.

The search for structure whitens and weights errors; a share of such errors would not be meaningful to users. Here the
whitening is undone, so the share refers to the model's actual errors.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from cmr.estimation.noise import Noise, SignalNoise
from cmr.estimation.prediction import Predictor
from cmr.recordings.signal import Floats

NOTHING = 1e-300  # smallest denominator: the share of an empty sum stays finite


def share_predicted(
    predictors: Sequence[Predictor], noise: Noise, white: Floats, predicted: Floats, signal: str
) -> float:
    """Return the share of the variance of a signal's one-step prediction errors that is predicted.

    Of all errors made white, shape (n,), `predicted` is the predicted part. Errors of poses are those beyond the
    influence of other sensors' errors. 0 if the prediction does not reduce them.
    """
    whole = left = 0.0
    for number, name, rows in _signals(predictors):
        if name == signal:
            of_signal = noise.of[name]
            whole += _power(coloured(white[rows], number, name, of_signal))
            left += _power(coloured(white[rows] - predicted[rows], number, name, of_signal))
    return max(0.0, 1.0 - left / max(whole, NOTHING))


def coloured(white: Floats, segment: int, name: str, noise: SignalNoise) -> Floats:
    """Undo the whitening of errors, (n,) in one segment; return them in the unit of the signal `name`.

    This is the inverse of Noise.white, except for the influence of other signals' errors.
    """
    spans = noise.spans(name)
    weights = np.concatenate([[1.0], -np.repeat(noise.past, spans)])
    count = len(white)
    length = 1 << int(np.ceil(np.log2(2 * (count + len(weights)))))  # space for ringing after the end
    spectrum = np.fft.rfft(white * noise.sizes[segment], length) / np.fft.rfft(weights, length)
    return np.asarray(np.fft.irfft(spectrum, length)[:count], np.float64)


def _signals(predictors: Sequence[Predictor]) -> Iterator[tuple[int, str, slice]]:
    """Yield segment, signal and rows of all white errors, segment by segment and signal by signal."""
    begin = 0
    for number, predictor in enumerate(predictors):
        for name, times in predictor.times.items():
            yield number, name, slice(begin, begin + len(times))
            begin += len(times)


def _power(errors: Floats) -> float:
    return float(errors @ errors)
