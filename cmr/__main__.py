"""`python -m cmr` is `cmr`."""

import sys

from cmr.commands import umbrella

sys.argv[0] = "cmr"
sys.exit(umbrella())
