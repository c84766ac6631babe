"""Messages on the bus as they arrive, undecoded."""

import time
from contextlib import suppress

from cmr.bus.messages import now_utime
from cmr.bus.preflight import handled, open_lcm, resolve_url, self_test, verifier_of
from cmr.bus.signing import RefusedSignature
from cmr.view.data.intake import Intake

LONGEST = 0.2  # s spent at once; a flood of messages must not block drawing


class Subscriber:
    """Receives everything on the bus at `url` and sends nothing. Raises BusError when the bus cannot be used."""

    def __init__(self, url: str | None, intake: Intake) -> None:
        resolved = resolve_url(url)
        self._verifier = verifier_of(resolved)
        self._lcm = open_lcm(resolved)
        self_test(self._lcm, resolved)
        self._intake = intake
        self._lcm.subscribe(".*", self._take).set_queue_capacity(0)  # unlimited

    def listen(self) -> None:
        """Forward what has arrived."""
        enough = time.monotonic() + LONGEST
        while handled(self._lcm) and time.monotonic() < enough:
            pass

    def _take(self, channel: str, data: bytes) -> None:
        with suppress(RefusedSignature):  # the page shows what processes act on; they count refusals
            self._intake.take(now_utime(), channel, self._verifier.verify(channel, data).data)
