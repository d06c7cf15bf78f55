"""The scan's state machine: which phase may follow which. The engine enters no other.

docs/pictures/states.py draws it; a test keeps the drawing equal to this file.
"""

from probe.core.events import Phase

PRESSING = (Phase.APPROACHING, Phase.INDENTING, Phase.HOLDING, Phase.RETRACTING)
_RUNNING = (
    Phase.CONNECTING,
    Phase.HOMING,
    Phase.TRAVELLING,
    Phase.TARING,
    *PRESSING,
    Phase.PAUSED,
)

ALLOWED: dict[Phase, tuple[Phase, ...]] = {
    Phase.IDLE: (Phase.CONNECTING,),
    Phase.CONNECTING: (Phase.HOMING, Phase.TRAVELLING, Phase.FINISHED),
    Phase.HOMING: (Phase.TRAVELLING, Phase.FINISHED),
    Phase.TRAVELLING: (Phase.TARING,),
    Phase.TARING: (Phase.APPROACHING,),
    Phase.APPROACHING: (Phase.INDENTING,),
    Phase.INDENTING: (Phase.HOLDING,),
    Phase.HOLDING: (Phase.RETRACTING,),
    Phase.RETRACTING: (Phase.TRAVELLING, Phase.PAUSED, Phase.FINISHED),
    Phase.PAUSED: (Phase.TRAVELLING, Phase.FINISHED),
    Phase.STOPPING: (Phase.RETRACTING, Phase.FINISHED),
    Phase.FINISHED: (),
}
for _phase in _RUNNING:  # whatever it is doing, it can be stopped
    ALLOWED[_phase] = (*ALLOWED[_phase], Phase.STOPPING)


def follow(now: Phase, then: Phase) -> Phase:
    """``then``, if it may follow ``now``. Raises `RuntimeError`: the engine would be wrong."""
    if then not in ALLOWED[now]:
        allowed = ", ".join(ALLOWED[now]) or "nothing"
        raise RuntimeError(f"phase {then} cannot follow {now}; allowed: {allowed}")
    return then
