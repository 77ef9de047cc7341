"""World: a batch of episodes of one scenario, advanced together.

Composes the models: vehicles fly, the plume is read, sensors sample, the radio delivers, batteries end flights. State
is batched (n_envs, n_uavs, ..) and owned here (layouts in `state.py`); physics is written once, over the batch. An
episode is a function of (scenario, seed, actions) alone, whatever the batch, the row or the process.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from osl_env.block import Block, Rules
from osl_env.errors import InputError
from osl_env.flying_bodies import begin_bodies
from osl_env.kernel_constants import kernel_constants
from osl_env.mailbox import Mailbox
from osl_env.observation import Observation, ObservationLayout
from osl_env.parameters import FloatArray
from osl_env.placement import draw_places
from osl_env.radio import ContactArray, Message
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.state import (
    ENDED,
    EPISODE,
    FRAME,
    LEDGER,
    MOTION,
    RUNNING,
    SENSES,
    TEAM,
    BoolArray,
    IntArray,
    StateArray,
)
from osl_env.stepping import begin, charge_payloads
from osl_env.streams import check_seed
from osl_env.surroundings import Surroundings
from osl_env.vehicles.quadrotor import Quadrotor
from osl_env.vehicles.rigid_body import STATE_SIZE

_MAX_STATE_BYTES = 16 * 2**30


class World:
    """`n_envs` episodes of `scenario` (a name, a path or a Scenario), stepped together. Call `reset` first.

    State to read, and never to write: `motion`, `ledger`, `senses` (n_envs, n_uavs), `heard` (n_envs, receiver,
    sender), `contacts` (see `radio`), `episode` (n_envs,), `source_position` (n_envs, n_sources, 3) m, `rewards`
    (n_envs, n_uavs) and `team` (n_envs,) of the last step.
    """

    def __init__(self, scenario: str | Scenario, n_envs: int = 1) -> None:
        """Allocate the state. Raises InputError if `n_envs` is not at least 1."""
        if isinstance(n_envs, bool) or not isinstance(n_envs, int | np.integer) or n_envs < 1:
            raise InputError(f"n_envs = {n_envs!r}: must be an integer of at least 1")
        self.scenario = load_scenario(scenario)
        self.n_envs, self.n_uavs = int(n_envs), self.scenario.team.n_uavs
        shape = (self.n_envs, self.n_uavs)
        self._check_memory()
        self.layout = ObservationLayout(self.scenario)
        self.constants = kernel_constants(self.scenario)
        self.motion: StateArray = np.zeros(shape, MOTION)
        self.ledger: StateArray = np.zeros(shape, LEDGER)
        self.senses: StateArray = np.zeros(shape, SENSES)
        self.episode: StateArray = np.zeros(self.n_envs, EPISODE)
        self.episode["outcome"] = ENDED + 1  # not begun: only a reset starts an episode
        self._place_arrays(shape)
        self._cursor = 0  # slot of the radio's queue that the last step wrote
        self._rules = Rules.of(self.scenario, self.constants)
        self._block = self._make_block()
        self._mailbox = Mailbox(self.scenario.radio.latency, self.n_envs, self.n_uavs)
        self._rows: FloatArray | None = None
        self._values: dict[int, list[tuple[Any, ...]]] = {}  # of the observations of a world, all at once

    def _check_memory(self) -> None:
        n_uavs, queue, radio = self.n_uavs, self._queue_length(), self.scenario.radio
        pairs = 0 if self.scenario.hears_all else n_uavs
        size = n_uavs * (600 + (FRAME.itemsize + 5) * pairs + queue * (FRAME.itemsize + pairs))  # bytes of a world
        if size > _MAX_STATE_BYTES:
            many = f"radio.latency = {radio.latency:g}: a world of {n_uavs} UAVs with so many frames on their way"
            raise InputError(f"{many} needs over 16 GiB")
        if self.n_envs * size > _MAX_STATE_BYTES:
            raise InputError(f"n_envs = {self.n_envs}: this many worlds of {n_uavs} UAVs need over 16 GiB")

    def _place_arrays(self, shape: tuple[int, int]) -> None:
        """Allocate what depends on the number of sources and on the radio."""
        sources = self.scenario.sources
        self.source_position: FloatArray = np.zeros((self.n_envs, sources.count, 3))
        self.source_strength: FloatArray = np.ones((self.n_envs, sources.count)) * np.array(sources.strengths or 1.0)
        self.surroundings = Surroundings(self.scenario, self.source_position, self.source_strength, self.n_uavs)
        bodies = (*shape, STATE_SIZE) if isinstance(self.scenario.vehicle, Quadrotor) else (0, 0, STATE_SIZE)
        self.body: FloatArray = np.zeros(bodies)  # see `vehicles.rigid_body`
        self.faults = self.scenario.uav_faults.allocate(*shape)
        self.rates: FloatArray = np.zeros(shape)
        self.rewards: FloatArray = np.zeros(shape)
        self.team: StateArray = np.zeros(self.n_envs, TEAM)
        self._stepping: BoolArray = np.zeros(self.n_envs, np.bool_)
        at_once = self.scenario.hears_all
        pairs = (self.n_envs, 0, 0) if at_once else (*shape, self.n_uavs)
        queue = self._queue_length()
        self.heard: StateArray = np.zeros(pairs, FRAME)
        self.contacts: ContactArray = np.zeros(pairs, np.int32)
        self._links: BoolArray = np.zeros(pairs, np.bool_)
        self._sent: StateArray = np.zeros((*pairs[:2], queue), FRAME)
        self._reach: BoolArray = np.zeros((*pairs[:2], queue, pairs[2]), np.bool_)

    def _make_block(self) -> Block:
        return Block(
            rules=self._rules,
            motion=self.motion,
            positions=self.motion["position"],
            ledger=self.ledger,
            senses=self.senses,
            episode=self.episode,
            sources=self.source_position,
            strengths=self.source_strength,
            stepping=self._stepping,
            rates=self.rates,
            surroundings=self.surroundings,
            rewards=self.rewards,
            team=self.team,
            links=self._links,
            heard=self.heard,
            contacts=self.contacts,
            sent=self._sent,
            reach=self._reach,
            body=self.body,
            faults=self.faults,
        )

    def _queue_length(self) -> int:
        latency = self.scenario.radio.latency
        if latency == 0:
            return 1
        per_step = self.n_uavs if self.scenario.clock == "event" else 1
        return per_step * (int(np.ceil(min(latency / self.scenario.decision_time, 1e12))) + 2)

    @property
    def running(self) -> BoolArray:
        """(n_envs,) bool: which episodes go on."""
        running: BoolArray = np.equal(self.episode["outcome"], RUNNING)
        return running

    @property
    def begun(self) -> BoolArray:
        """(n_envs,) bool: which worlds have been reset at least once."""
        begun: BoolArray = np.less_equal(self.episode["outcome"], ENDED)
        return begun

    @property
    def ranges(self) -> FloatArray:
        """(n_envs, n_uavs, n_rays) m: what the range sensors saw last."""
        return self.surroundings.ranges

    @property
    def links(self) -> BoolArray:
        """(n_envs, sender, receiver) bool: who gets the frames of the last step."""
        if not self._rules.to_all:
            return self._links
        sends = self.motion["active"] & self.motion["ready"] & self._rules.talks
        pairs: BoolArray = sends[:, :, None] & self.motion["active"][:, None, :] & ~np.eye(self.n_uavs, dtype=np.bool_)
        return pairs

    @property
    def hop_offsets(self) -> FloatArray:
        """What each hop action moves by, hovering last: (26 l_max + 1, 3) m."""
        return self._rules.hop_table[:, :3]

    def reset(self, seeds: ArrayLike | Sequence[int], mask: BoolArray | None = None) -> None:
        """Begin the episodes with `seeds` (n_envs,) in the worlds of `mask` (n_envs,) bool; in all without a mask.

        On legs every UAV hovers and samples once where it starts (so the clock begins at one hovering time).
        """
        numbers = np.asarray(seeds)
        if numbers.shape != (self.n_envs,) or numbers.dtype.kind not in "iu":
            raise InputError(f"seeds: must be {self.n_envs} integers, one for each world, not {seeds!r:.80}")
        rows = np.arange(self.n_envs) if mask is None else np.flatnonzero(mask)
        if rows.size == 0:
            return
        if int(numbers[rows].min()) < 0 or int(numbers[rows].max()) >= 2**63:
            check_seed(int(numbers[rows].min()))
            check_seed(int(numbers[rows].max()))
        chosen = numbers[rows].astype(np.int64)
        stepping = self._stepping
        stepping[:] = False
        stepping[rows] = True
        self._place(rows, chosen)
        first_hover = 0.0 if self.scenario.in_periods else self._rules.sampling_time
        begin(self.motion, self.ledger, self.senses, self.heard, self.contacts, self._sent, self.episode,
              self.constants, rows, chosen, first_hover)  # fmt: skip
        if self._rules.frames is not None:
            begin_bodies(self.body, self._rules.frames, self.motion, rows)
        self.surroundings.begin(rows, chosen, self.episode)
        self._mailbox.clear(rows)
        if self.faults is not None:
            self.faults.begin(rows, chosen)
        self._block.settle(self._cursor, is_step=False)  # the last step's slot: theirs has just been emptied
        self._rows = None

    def _place(self, rows: IntArray, seeds: IntArray) -> None:
        team, sources = self.scenario.team, self.scenario.sources
        starts = np.zeros((rows.size, self.n_uavs, 3))
        places = np.zeros((rows.size, sources.count, 3))
        if team.region is None:
            starts[:] = team.starts[: self.n_uavs]
        if sources.region is None:
            places[:] = sources.positions
        nothing = np.empty((0, 3))
        team_region = nothing if team.region is None else np.array(team.region)
        source_region = nothing if sources.region is None else np.array(sources.region)
        if not draw_places(seeds, team_region, team.spacing, source_region, sources.minimum_distance,
                           self._rules.geometry, starts, places):  # fmt: skip
            raise InputError(f"team.spacing = {team.spacing:g}: no room found for {self.n_uavs} UAVs in team.region")
        self.source_position[rows] = places
        self.motion["position"][rows] = starts

    def _advance(self) -> None:
        self._cursor = (self._cursor + 1) % self._sent.shape[2]
        self._rows = None

    def step_hops(self, actions: IntArray) -> None:
        """One step of hops: `actions` (n_envs, n_uavs) int64, direction * l_max + length - 1; 26 l_max hovers; one
        more declares.

        Not checked here: the views do that. UAVs that are not ready, and worlds that have ended, ignore theirs.
        """
        self._advance()
        self._block.hop(actions, self._cursor)

    def step_waypoints(self, targets: FloatArray, samples: IntArray, declarations: FloatArray | None = None) -> None:
        """One step of legs to `targets` (n_envs, n_uavs, 3) m with `samples` (n_envs, n_uavs) int64 at each end.

        `declarations` (n_envs, n_uavs, 3) m, NaN where there is none, are judged first and end their episodes.
        """
        self._advance()
        self._block.fly_to(targets, samples, declarations, self._cursor)

    def step_velocities(self, velocities: FloatArray, declarations: FloatArray | None = None) -> None:
        """One decision period with `velocities` (n_envs, n_uavs, 3) m/s; `declarations` as in `step_waypoints`."""
        self._advance()
        self._block.fly_period(velocities, declarations, self._cursor, tracks=False)

    def step_setpoints(self, setpoints: FloatArray, declarations: FloatArray | None = None) -> None:
        """One decision period in which UAVs steer to `setpoints` (n_envs, n_uavs, 3) m; `declarations` as in
        `step_waypoints`.
        """
        self._advance()
        self._block.fly_period(setpoints, declarations, self._cursor, tracks=True)

    def concentration(self, env: int, points: ArrayLike) -> FloatArray:
        """The plume's present reading in world `env` at `points` (.., 3) m, in its unit; shape (..). For pictures: no
        UAV knows it.
        """
        return self.surroundings.reading(env, np.asarray(points, dtype=np.float64))

    def wind_at(self, env: int, points: ArrayLike) -> FloatArray:
        """The air's present velocity, m/s, in world `env` at `points` (.., 3) m; shape (.., 3). For pictures."""
        return self.surroundings.velocity(env, np.asarray(points, dtype=np.float64))

    def run_air(self, seconds: float) -> None:
        """Let air and plume of all worlds go on for `seconds`, without the UAVs; the clocks stay. For pictures."""
        self.surroundings.go_on(seconds)

    def observation(self, env: int, uav: int) -> Observation:
        """What UAV `uav` of world `env` may know now."""
        rows = self.physical
        if self.scenario.clock == "event":  # few decide at a time
            return self.layout.observation(rows[env, uav])
        if env not in self._values:
            self._values[env] = self.layout.values(rows[env])
        return Observation(*self._values[env][uav])

    @property
    def physical(self) -> FloatArray:
        """The physical rows of all observations now (n_envs, n_uavs, layout.size); the same array until the next
        step.
        """
        if self._rows is None:
            self._rows, self._values = self.layout.physical(self), {}
        return self._rows

    def exchange(
        self, payloads: Sequence[Sequence[bytes | None]], computed_bits: FloatArray | None = None
    ) -> list[list[list[Message]]]:
        """Attach the policies' `payloads` to this step's frames: what every UAV has received, [env][uav] -> messages.

        Charges the sender for its payload's bytes, and for `computed_bits` (n_envs, n_uavs), if given. A UAV that is
        not ready sends nothing, and finds its messages at its next decision. Messages come in the order sent.
        """
        lengths = np.array([[len(payload or b"") for payload in team] for team in payloads], dtype=np.int64)
        lengths[~(self.motion["active"] & self.motion["ready"])] = 0
        bits = np.zeros(self.motion.shape) if computed_bits is None else computed_bits
        charge_payloads(self.motion, self.ledger, self.constants, lengths, bits)
        return self._mailbox.exchange(self, payloads)
