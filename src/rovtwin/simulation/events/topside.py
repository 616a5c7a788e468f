"""What happens above the water: a line that falls silent, an operator who does or asks something, a late computer."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.flow import ABORT, NO_REQUEST, PILOT, Host
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Index, Scalar

Spans = Sequence[tuple[float, float]]
LATE = 10.0  # control periods by which a late computer is late


class Topside(eqx.Module):
    """A time-line of it; m spans each.

    Attributes:
        link: Without a word from the vehicle [s].
        operator: Without one from the operator [s].
        late: In which ticks come late [s].
        times: Of the operator's requests [s].
        requests: Those of core.flow.
        pilot: Velocity that each asks for, see core.flow.AutopilotInput.
    """

    link: Float[Array, "l 2"]
    operator: Float[Array, "m 2"]
    late: Float[Array, "n 2"]
    times: Float[Array, " k"]
    requests: Int[Array, " k"]
    pilot: Float[Array, "k 4"]

    @classmethod
    def of(
        cls,
        link: Spans = (),
        operator: Spans = (),
        late: Spans = (),
        requests: Sequence[tuple[float, int]] = (),
        pilot: Sequence[Sequence[float]] | None = None,
    ) -> "Topside":
        """From lists; of two requests in one control tick the later one counts, and ABORT before all others."""
        order = sorted(range(len(requests)), key=lambda i: (requests[i][1] == ABORT, requests[i][0]))
        ordered = [requests[i] for i in order]
        commands = [(0.0, 0.0, 0.0, 0.0) if pilot is None else pilot[i] for i in order]
        return cls(
            link=as_array(np.reshape(link, (-1, 2))),
            operator=as_array(np.reshape(operator, (-1, 2))),
            late=as_array(np.reshape(late, (-1, 2))),
            times=as_array([t for t, _ in ordered]),
            requests=jnp.asarray([r for _, r in ordered], dtype=int),
            pilot=as_array(np.reshape(commands, (-1, 4))),
        )

    def at(self, t: Scalar, dt: float) -> tuple[Host, Index, Float[Array, "4"]]:
        """What the host knows at time t [s], the request of a tick of dt seconds, the pilot's command."""
        host = Host(_age(self.link, t), _age(self.operator, t), jnp.where(_age(self.late, t) > 0.0, LATE, 0.0))
        now = jnp.round(self.times / dt) == jnp.round(t / dt)
        request, command = jnp.asarray(NO_REQUEST), jnp.zeros(4)
        for i in range(self.times.shape[0]):
            request = jnp.where(now[i], self.requests[i], request)
            piloted = (self.requests[i] == PILOT) & (jnp.round(self.times[i] / dt) <= jnp.round(t / dt))
            command = jnp.where(piloted, self.pilot[i], command)
        return host, request, command


def _age(spans: Float[Array, "m 2"], t: Scalar) -> Scalar:
    """How long one of the spans has lasted [s]; 0 outside."""
    within = (spans[:, 0] <= t) & (t < spans[:, 1])
    return jnp.max(jnp.where(within, t - spans[:, 0], 0.0), initial=0.0)
