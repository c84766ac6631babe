"""What is compiled of the plant is kept where pip has nothing to leave behind."""

from pathlib import Path
from typing import Any

import cmr
from cmr.plant.compiling import loaded
from cmr.plant.motors import friction_size
from cmr.plant.running import go_on


def test_compiled_code_is_not_kept_in_the_package() -> None:
    functions: list[Any] = [friction_size, loaded(go_on)]
    for function in functions:
        assert not Path(function._cache.cache_path).is_relative_to(cmr.__path__[0])
