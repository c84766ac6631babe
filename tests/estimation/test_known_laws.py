"""Laws that are effects of the catalogue in other words are found to be these."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.estimation.laws import known
from cmr.estimation.laws.known import SAME, Known


@pytest.mark.parametrize(("share", "name"), [(0.5 * (1.0 + SAME), "gyro_scale"), (0.9, "")])
def test_where_little_is_left_beside_the_parameters_whole_traces_are_compared(
    share: float, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nearly all of a gyro's scale is a wider base, too: what is left of effect and law need not be alike."""
    base, effect, other = np.eye(3)[:, :1], np.eye(3)[:, 1:2], np.eye(3)[:, 2:]
    law = np.sqrt(share) * base + np.sqrt(1.0 - share) * other
    monkeypatch.setattr(known, "_traces_of", lambda *_law: 5.0 * law)
    rest = SimpleNamespace(basis=base)
    found = Known([("gyro_scale", effect)], [("gyro_scale", base)], {}, cast(Any, rest))
    assert found.same_as(cast(Any, None), cast(Any, None)) == name
