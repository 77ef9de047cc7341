"""Col-PF: the collaborative particle filter of MUC-OSL (eqs 10 to 20).

An iteration: neighbours' readings count to the power of the beliefs' likeness beta (eqs 10, 11); the cloud is resampled
when its effective sample size asks for it; N_s particles are moved by what the environment and the neighbours suggest
(eqs 15 to 17); N_k particles are drawn, a number that follows the distance to the estimate and the rate of detections
(eq 18); a Gaussian of 12 numbers is what neighbours get (eqs 19, 20). Parameters whose default is not the printed one:

parameter            default                        printed
beta                 exp(-(KL_ij + KL_ji) / 12)     exp(-KL_ij) (eq 10): shuts sharing when the clouds differ
environment_update   jitter, Gaussian, of 1 m       eq 16: depends on the origin of the coordinates
attraction           mean: sum beta mu / sum beta   sum: of beta mu, a point out of the area
attracted_share      0.05 of the moved particles    1: halves the cloud at every step
count_rule           N_0 f_dist (1 - f_cue)         recursion on N (eq 18): decays to N_min

Eq 16 is read with theta the direction of an upwind move, measured from the x axis. As in all moves, one that leaves
the area is rejected. Since N_k changes with every iteration, particles are drawn anew in each (Algorithm 1), besides
the resampling at ESS < N/2 before they are moved; `redraw = "on_resampling"` does it only in iterations that
resample, and then finds the source less often (this default was chosen after seeing seeds 0 to 99). Detections are
the UAV's own; for eq 17 a neighbour has had one if a frame heard from it said so. Iterations k count from 1 at the
first reading, and k_0 = 0.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from baselines.belief.likelihood import HitModel
from baselines.belief.particle_filter import ParticleBelief
from baselines.muc_osl.col_pf_kernels import JITTER, NO_UPDATE, PRINTED, UPWIND, Step, col_pf_update
from baselines.muc_osl.messages import pack_gaussian, unpack_gaussians
from baselines.policy import Briefing
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.radio import Message

_UPDATES = {"none": NO_UPDATE, "jitter": JITTER, "upwind": UPWIND, "printed": PRINTED}


class ColPFParameters(Parameters):
    """Parameters of `ColPF`; defaults of Table 1 and of the paper page's readings."""

    particles: int = quantity(100, "", ge=2, le=100_000)  # N_0
    min_particles: int | None = quantity(20, "", ge=2)  # N_min; None: Lx Ly Lz / (2 sqrt(D tau))^3
    max_particles: int = quantity(160, "", ge=2)  # N_max, of the recursion alone
    count_rule: Literal["from_initial", "recursion", "fixed"] = "from_initial"  # eq 18
    cue_detections: int = quantity(3, "", ge=1)  # dc of f_cue
    resample_below: float = quantity(0.5, "", ge=0, le=1)  # effective sample size over N; 1: at every iteration
    redraw: Literal["every_iteration", "on_resampling"] = "every_iteration"  # when N_k particles are drawn anew
    beta: Literal["symmetric", "printed"] = "symmetric"  # eq 10
    gamma1: float = quantity(1.8, "", gt=0)  # of eq 15
    gamma2: float = quantity(4.0, "", gt=0)  # of eq 15
    environment_update: Literal["jitter", "upwind", "printed", "none"] = "jitter"  # eq 16
    update_length: float = quantity(1.0, "m", ge=0)  # standard deviation of the jitter; longest upwind step
    attraction: Literal["mean", "sum"] = "mean"  # gbest of eq 17
    attracted_share: float = quantity(0.05, "", ge=0, le=1)  # of the moved particles


class ColPF:
    """Estimator: the collaborative particle filter of one UAV (see the module)."""

    __slots__ = ("_bounds", "_cues", "_horizon", "_iteration", "_parameters", "_senders", "belief")

    def __init__(self, parameters: ColPFParameters, briefing: Briefing) -> None:
        self._parameters = parameters
        self.belief = ParticleBelief(parameters.particles, briefing.area, briefing.seed)
        self._horizon = briefing.max_decisions  # k_max
        self._iteration = 0  # k
        self._cues: deque[int] = deque([0], maxlen=parameters.cue_detections + 1)  # iterations of own detections
        self._senders: set[int] = set()  # neighbours known to have had a detection
        least = parameters.min_particles
        if least is None:
            spacing = 2.0 * math.sqrt(briefing.plume.diffusivity * briefing.plume.lifetime)
            least = math.ceil(float(np.prod(briefing.area)) / spacing**3)
        most = parameters.max_particles if parameters.count_rule == "recursion" else parameters.particles
        self._bounds = (parameters.particles,) * 2 if parameters.count_rule == "fixed" else (min(least, most), most)

    def message(self) -> bytes:
        """The Gaussian of the last iteration, 12 numbers (eqs 19, 20); a frame's header holds the measurement."""
        return pack_gaussian(self.belief.gaussian)

    def update(self, readings: FloatArray, inbox: Sequence[Message], model: HitModel) -> None:
        """Take in `readings` (1 + F, 6), the UAV's own first, and the Gaussians of the F frames of `inbox`."""
        belief = self.belief
        self._iteration += 1
        hits, sampling_time = readings[0, 3:5].tolist()
        if hits > 0.0 and sampling_time > 0.0:
            self._cues.append(self._iteration)
        belief.cloud, belief.entropy = col_pf_update(
            belief.cloud,
            belief.gaussian,
            readings,
            unpack_gaussians(inbox),
            self._detected(inbox),
            model,
            self._step(model),
            belief.area,
            belief.random,
        )

    def _detected(self, inbox: Sequence[Message]) -> NDArray[np.bool_]:
        """(F,): whether the sender of each frame is known to have had a detection."""
        for message in inbox:
            if message.reading > 0.0:
                self._senders.add(message.sender)
        return np.array([message.sender in self._senders for message in inbox], dtype=np.bool_)

    def _step(self, model: HitModel) -> Step:
        parameters = self._parameters
        speed = math.hypot(model.drift_x, model.drift_y)
        progress = min(self._iteration / self._horizon, 1.0)
        return Step(
            resample_below=parameters.resample_below,
            redraw=parameters.redraw == "every_iteration",
            full_count=self._full_count(),
            least_count=self._bounds[0],
            most_count=self._bounds[1],
            nearness=parameters.count_rule != "fixed",
            printed_beta=parameters.beta == "printed",
            moved_share=(1.0 - progress**parameters.gamma1) ** parameters.gamma2,  # eq 15
            update=_UPDATES[parameters.environment_update],
            update_length=parameters.update_length,
            upwind_x=-model.drift_x / speed if speed > 0.0 else 0.0,
            upwind_y=-model.drift_y / speed if speed > 0.0 else 0.0,
            attracted_share=parameters.attracted_share if len(self._cues) == 1 else 0.0,
            summed_attraction=parameters.attraction == "sum",
        )

    def _full_count(self) -> float:
        """N (1 - f_cue) of eq 18, with the N that its rule starts from."""
        parameters, cues = self._parameters, self._cues
        if parameters.count_rule == "fixed":
            return float(parameters.particles)
        count = self.belief.count if parameters.count_rule == "recursion" else parameters.particles
        if len(cues) <= parameters.cue_detections:
            return float(count)
        return count * (1.0 - parameters.cue_detections / (self._iteration - cues[0]))
