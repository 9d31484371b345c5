"""Whole tests: all decide, then move for 1 s in substeps of 0.1 s, and every pair of boxes is looked at every time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise

from cornerforge.drivers.sight import Sight
from cornerforge.ndd.model import NddModel
from cornerforge.types import Odd
from reference.adversaries import ADVERSARIES, draws
from reference.drivers import AvDriver, Naturalistic, Row, look_up_word, rank_of
from reference.elementary import log
from reference.philox import DECIDE, Stream, unit
from reference.world import FOLLOWED, HUMAN, SIGHT, TRUCK, Vehicle, World, start

HOLD = 22
"""Index of the action that holds the speed."""

__all__ = ["Drive", "Simulator"]

CONFLICT_GAP, BESIDE = 10.0, 2.0
COMPLETED, AV_CRASH, BV_CRASH, TIME_UP = 1, 2, 3, 4
Action = int


@dataclass
class Drive:
    """A test as it went: frames of (copies of) the vehicles, decisions, and how it ended.

    `start` is before anybody decides, the first frame just after.
    """

    start: list[Vehicle] = field(default_factory=list)
    frames: list[list[Vehicle]] = field(default_factory=list)
    actions: list[dict[int, Action]] = field(default_factory=list)
    critical: list[int] = field(default_factory=list)
    probability: list[float] = field(default_factory=list)
    outcome: int = 0
    contact: tuple[int, int] = (0, 0)
    bv_crashes: int = 0


@dataclass(frozen=True)
class Simulator:
    """All that is constant in a run; `adversary` None is natural driving."""

    odd: Odd
    model: NddModel
    av: AvDriver
    adversary: str | None = None
    bounded: bool = False
    idm_bvs: bool = False
    budget: float | None = None
    excess: bool = False
    steers_from: int = 0
    tables: Naturalistic = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tables", Naturalistic(self.model))

    def drive(self, seed: int, test: int) -> Drive:
        """One test, from its start to its end."""
        stream = Stream(seed, test)
        return _Test(self, stream, start(self.odd, self.model, self.av, stream)).run()

    # What a driver would do, seen from one world

    def idm_behind_all(self, world: World, subject: Vehicle, lanes: set[int], sight: Sight) -> float:
        """The least of the IDM's accelerations over the leads in these lanes of the subject's."""
        commands = [self.av.follow(subject.speed, math.inf, 0.0)]
        for lane in lanes & set(range(self.odd.n_lanes)):
            lead, _ = world.neighbours(subject, lane, sight)
            if lead is not None:
                commands.append(self.av.follow(subject.speed, world.gap(lead, subject), lead.speed - subject.speed))
        return min(commands)

    def av_wish(self, world: World) -> tuple[float, int]:
        """The AV's acceleration and target lane."""
        av, kind = world.av, self.av.kind
        if kind == "plain":
            return self.plain_wish(world)
        command, lane = self.plain_wish(world) if kind == "watchful" else self.cautious_wish(world)
        centre_lane = math.floor(av.y / self.odd.lane_width)
        if av.path is not None and centre_lane != av.target_lane:
            unwelcome = self._someone_enters_too(world, centre_lane) or self.refuses(world, av.target_lane)
            return command, centre_lane if unwelcome and not self.somebody_beside(world, centre_lane) else lane
        rivals = [
            bv
            for bv in world.bvs()
            if bv.lane_entered(self.av.sight, self.odd) == av.target_lane != math.floor(bv.y / self.odd.lane_width)
            and abs(bv.x - av.x) < bv.room_to(av) + BESIDE
        ]
        return self.evasion(world, min(rivals, key=lambda bv: abs(bv.x - av.x)), command) if rivals else (command, lane)

    def evasion(self, world: World, rival: Vehicle, command: float) -> tuple[float, int]:
        """Away from one who comes in beside the AV, or let it in, or go ahead of it."""
        av = world.av
        from_left = math.floor(rival.y / self.odd.lane_width) > av.target_lane
        away = av.target_lane + (-1 if from_left else 1)
        if av.path is None and away in range(self.odd.n_lanes) and not self.refuses(world, away):
            return command, away
        if rival.x >= av.x - 0.5 * av.length:
            return min(command, -self.av.idm.max_braking), av.target_lane
        return self.av.idm.max_acceleration if command >= 0.0 else command, av.target_lane

    def cautious_wish(self, world: World) -> tuple[float, int]:
        """As the plain one, but at RSS distances."""
        av = world.av
        command = self.idm_behind_all(world, av, av.lanes, self.av.sight)
        for lane in av.lanes & set(range(self.odd.n_lanes)):
            lead, _ = world.neighbours(av, lane, self.av.sight)
            if lead is not None:
                command = min(command, self.av.proper_response(av.speed, world.gap(lead, av), lead.speed))
        return command, av.target_lane if av.path is not None else self._best_lane(world, command)

    def somebody_beside(self, world: World, lane: int) -> bool:
        """Does the nearest vehicle ahead or behind in a lane overlap the AV lengthwise?"""
        lead, rear = world.neighbours(world.av, lane, self.av.sight)
        gaps = [world.gap(lead, world.av)] if lead is not None else []
        gaps += [world.gap(world.av, rear)] if rear is not None else []
        return min(gaps, default=math.inf) <= 0.0

    def refuses(self, world: World, lane: int) -> bool:
        """Would an AV that is not plain rather not be in that lane?"""
        av = world.av
        if self.somebody_beside(world, lane):
            return True
        lead, rear = world.neighbours(av, lane, self.av.sight)
        if self.av.kind == "cautious":
            near = lead is not None and world.gap(lead, av) < self.av.rss_ahead(av.speed, lead.speed)
            return near or (rear is not None and world.gap(av, rear) < self.av.rss_behind(rear.speed, av.speed))
        states = [(av, lead, world.gap(lead, av))] if lead is not None else []
        states += [(rear, av, world.gap(av, rear))] if rear is not None else []
        states.append((av, av, math.inf))
        return any(
            self.av.follow(behind.speed, gap, ahead.speed - behind.speed) < -self.av.mobil.max_imposed_braking
            for behind, ahead, gap in states
        )

    def plain_wish(self, world: World) -> tuple[float, int]:
        """IDM and MOBIL."""
        av = world.av
        command = self.idm_behind_all(world, av, av.lanes, self.av.sight)
        if av.path is not None:
            old = math.floor(av.y / self.odd.lane_width)
            return command, old if self._someone_enters_too(world, old) else av.target_lane
        return command, self._best_lane(world, command)

    def _best_lane(self, world: World, command: float) -> int:
        av = world.av
        best, best_gain = av.target_lane, self.av.mobil.min_gain
        for lane in (av.target_lane + 1, av.target_lane - 1):
            gain = self._side_gain(world, lane, command) if 0 <= lane < self.odd.n_lanes else None
            if gain is not None and gain > best_gain and not (self.av.kind == "cautious" and self.refuses(world, lane)):
                best, best_gain = lane, gain
        return best

    def _side_gain(self, world: World, lane: int, now: float) -> float | None:
        av = world.av
        lead, rear = world.neighbours(av, lane, self.av.sight)
        polite = rear is not None and self.av.mobil.politeness > 0.0
        return self.av.gain(
            av.speed,
            now,
            None if lead is None else (world.gap(lead, av), lead.speed),
            None if rear is None else (world.gap(av, rear), rear.speed),
            self.idm_behind_all(world, rear, rear.lanes_seen(self.av.sight, self.odd), self.av.sight)
            if rear is not None and polite
            else 0.0,
        )

    def _someone_enters_too(self, world: World, old: int) -> bool:
        """Another vehicle comes into the AV's target lane from the far side while the AV is still in its old lane."""
        av = world.av
        return old != av.target_lane and any(
            bv.lane_entered(self.av.sight, self.odd) == av.target_lane
            and math.floor(bv.y / self.odd.lane_width) not in (av.target_lane, old)
            and abs(bv.x - av.x) < bv.room_to(av) + CONFLICT_GAP
            for bv in world.bvs()
        )

    def states(self, world: World, bv: Vehicle) -> list[tuple[float, float]]:
        """(gap, range rate) to the lead in each lane that a BV is in, the nearest first; (inf, 0) where it is free."""
        leads = [lead for lane in bv.lanes if (lead := world.neighbours(bv, lane, FOLLOWED)[0]) is not None]
        return sorted((world.gap(lead, bv), lead.speed - bv.speed) for lead in leads) or [(math.inf, 0.0)]

    def rows(self, world: World, bv: Vehicle, rounding: float) -> list[Row]:
        """Rows of accelerations, one per lead."""
        return [self.tables.row(bv.speed, bv.desired_speed, *state, rounding) for state in self.states(world, bv)]

    def follows(self, world: World, bv: Vehicle) -> bool:
        """Has a BV a lead in any lane that it is in? Only then does its driver remember."""
        return any(world.neighbours(bv, lane, FOLLOWED)[0] is not None for lane in bv.lanes)

    def acceptance(self, world: World, bv: Vehicle, lane: int, overlook: float) -> float:
        """Chance that a BV accepts its neighbours in a lane."""
        chance = 1.0
        lead, rear = world.neighbours(bv, lane)
        if lead is not None:
            state = world.gap(lead, bv), lead.speed - bv.speed
            chance *= self.tables.accepts(*state, rear=False, overlook=overlook)
        if rear is not None:
            state = world.gap(bv, rear), bv.speed - rear.speed
            seen = self.tables.accepts(*state, rear=True, overlook=overlook)
            ignored = self.odd.ignored_rear if state[0] >= 5.0 else 0.0
            chance *= seen + ignored * (1.0 - overlook) * (1.0 - self.tables.accepts(*state, rear=True, overlook=0.0))
        return chance

    def flight(self, world: World, bv: Vehicle, lane: int) -> float:
        """Chance that an attentive driver in a running change leaves a lane, for the worse of two neighbours there."""
        lead, rear = world.neighbours(bv, lane)
        wishes = [0.0]
        if lead is not None:
            wishes.append(self.tables.flees(world.gap(lead, bv), lead.speed - bv.speed))
        if rear is not None:
            wishes.append(self.tables.flees(world.gap(bv, rear), bv.speed - rear.speed))
        return max(wishes)

    def side_chances(self, world: World, bv: Vehicle, overlook: float) -> tuple[float, float]:
        """P(left), P(right): to begin a lane change, by the wish behind the nearest lead, or to turn back in one."""
        chances = [0.0, 0.0]
        if bv.path is not None:
            old = math.floor(bv.y / self.odd.lane_width)
            if old != bv.target_lane and self.flight(world, bv, old) < 1.0:
                back = (1.0 - overlook) * self.flight(world, bv, bv.target_lane)
                chances[0 if old > bv.target_lane else 1] = back
            return chances[0], chances[1]
        base = self.tables.wish_to_change(bv.speed, *self.states(world, bv)[0])
        is_closed = bv.kind == TRUCK and self.odd.truck_share > 0.0 and self.odd.n_lanes >= 3
        for side, lane in enumerate((bv.target_lane + 1, bv.target_lane - 1)):
            if 0 <= lane < self.odd.n_lanes - is_closed:
                chances[side] = base * self.acceptance(world, bv, lane, overlook)
        return chances[0], min(chances[1], 1.0 - chances[0])  # one number decides, the left first

    def chance_to_go_too(self, world: World, bv: Vehicle, other: Vehicle) -> float:
        """Chance that an attentive driver starts into a lane at the moment when one ahead starts into it."""
        if other.x - bv.x >= SIGHT:
            return 1.0
        gap, rate = world.gap(other, bv), other.speed - bv.speed
        return self.tables.accepts(gap, rate, rear=False, overlook=0.0)

    def chance_to_look_away(self, bv: Vehicle) -> float:
        """P(a driver looks away in this second)."""
        memory = self.model.memory
        return memory.away_again if bv.away else min(1.0, bv.inattention * memory.away)

    def start_chance(self, world: World, vehicle: Vehicle, lane: int, av_lane: int) -> float:
        """P(a vehicle starts into a lane), if it waits for nobody."""
        if vehicle is world.av:
            return float(av_lane == lane != vehicle.target_lane)
        looks = 1.0 - self.chance_to_look_away(vehicle)
        left, right = (looks * chance for chance in self.side_chances(world, vehicle, self.model.overlook))
        return {vehicle.target_lane + 1: left, vehicle.target_lane - 1: right}.get(lane, 0.0)

    def chance_not_to_wait(self, world: World, bv: Vehicle, lane: int, conflict: float, av_lane: int) -> float:
        """P(a BV that wants into a lane goes): it may wait for those ahead that start into it at the same moment.

        From the front to the rear, with the probability of every set of starters; forgotten are those whom nobody
        further behind waits for.
        """
        ahead = [v for v in world.from_rear_to_front() if (v.x, v.slot) > (bv.x, bv.slot)]
        sets: dict[frozenset[Vehicle], float] = {frozenset(): 1.0}
        for place in range(len(ahead) - 1, -1, -1):
            vehicle, behind = ahead[place], [bv, *ahead[:place]]
            wants = self.start_chance(world, vehicle, lane, av_lane)
            if wants == 0.0:
                continue
            minds = vehicle is not world.av and vehicle.path is None
            after: dict[frozenset[Vehicle], float] = {}
            for starters, chance in sets.items():
                least = min((self.chance_to_go_too(world, vehicle, other) for other in starters), default=1.0)
                goes = wants * (1.0 - (1.0 - self.model.overlook_conflict) * (1.0 - least) if minds else 1.0)
                for now, share in ((starters, 1.0 - goes), (starters | {vehicle}, goes)):
                    kept = frozenset(m for m in now if any(self.chance_to_go_too(world, k, m) < 1.0 for k in behind))
                    if share > 0.0:
                        after[kept] = after.get(kept, 0.0) + chance * share
            sets = after
        leasts = (
            (chance, min((self.chance_to_go_too(world, bv, other) for other in starters), default=1.0))
            for starters, chance in sets.items()
        )
        return sum(chance * (1.0 - (1.0 - conflict) * (1.0 - least)) for chance, least in leasts)

    def probabilities(self, world: World, bv: Vehicle, av_lane: int, *, attentive: bool) -> list[float]:
        """P(action) of a BV among others that drive naturally and an AV that has chosen its target lane."""
        overlook, conflict = (0.0, 0.0) if attentive else (self.model.overlook, self.model.overlook_conflict)
        left, right = self.side_chances(world, bv, overlook)
        if bv.path is None:
            left *= self.chance_not_to_wait(world, bv, bv.target_lane + 1, conflict, av_lane) if left else 1.0
            right *= self.chance_not_to_wait(world, bv, bv.target_lane - 1, conflict, av_lane) if right else 1.0
        # Range rates are rounded up from some rounding on; between these limits the rows stay the same.
        limits = {1.0 - (rate - math.floor(rate)) for _, rate in self.states(world, bv)} | {0.0, 1.0}
        cumulative = [0.0] * 31
        remembers = self.follows(world, bv)
        for low, high in pairwise(sorted(limits)):
            rows = self.rows(world, bv, 0.5 * (low + high))
            # One word serves all rows, so the smallest index has the largest of the distribution functions.
            for index, values in enumerate(zip(*(row.cumulative for row in rows), strict=True)):
                share = rank_of(max(values), bv.noise)
                if remembers:
                    share = self.tables.share_below(min(share, 1.0), bv.quantile, bv.habit)
                cumulative[index] += (high - low) * share
        keep = (1.0 - left - right) / cumulative[-1]
        steps = [0.0] * 31
        for index, (a, b) in enumerate(zip([0.0, *cumulative], cumulative, strict=False)):
            steps[bv.can(index)] += b - a
        p = [left, right, *(keep * step for step in steps)]
        away = 0.0 if attentive else self.chance_to_look_away(bv)
        return [(1.0 - away) * chance + (away if action == HOLD else 0.0) for action, chance in enumerate(p)]

    def allowed(self, world: World, bv: Vehicle, left: int | None) -> list[Action]:
        """Actions that the adversary may take; `left` of its budget in millionths of a nat, None: no limit."""
        lane = bv.target_lane
        running = bv.running_side(self.odd)
        allowed = set(range(2, 33))
        if lane + 1 < self.odd.n_lanes and running != 1:
            allowed.add(0)
        if lane > 0 and running != -1:
            allowed.add(1)
        if self.bounded:
            possible = self.probabilities(world, bv, world.av.target_lane, attentive=False)
            allowed = {action for action in allowed if possible[action] > 0.0}
            if left is not None:
                allowed = {action for action in allowed if self.price(possible, action) <= left}
        return sorted(allowed)

    def price(self, chances: list[float], action: Action) -> int:
        """How much less likely an action is than the likeliest, in millionths of a nat, rounded up."""
        free = log(max(chances))
        if self.excess:
            free = min(free, sum(p * log(p) for p in chances if p > 0.0))
        return math.ceil((free - log(chances[action])) * 1e6)


def words_of(rows: list[Row], index: int, bv: Vehicle) -> tuple[int, int]:
    """From which word on and below which the least of the rows' accelerations has an index; equal for never."""
    alike = [k for k in range(31) if bv.can(k) == index]
    if not alike:
        word = 0 if bv.can(index) > index else 2**32 - 1
        return word, word
    low = max(row.cuts[alike[0] - 1] if alike[0] > 0 else 0 for row in rows)
    high = min(max(row.cuts[alike[-1]] for row in rows), 2**32 - 1)
    return low, high


@dataclass
class _Test:
    """One running test."""

    simulator: Simulator
    stream: Stream
    world: World
    drive: Drive = field(default_factory=Drive)
    step: int = 0
    controlled: Vehicle | None = None
    budget_left: int | None = None
    looked_away: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        if self.simulator.budget is not None:
            self.budget_left = round(self.simulator.budget * 1e6)

    def run(self) -> Drive:
        odd = self.simulator.odd
        self.drive.start = [replace(vehicle) for vehicle in self.world.vehicles]
        while not self.drive.outcome:
            self.decide()
            self.step += 1
            self.move_for_a_second()
            if not self.drive.outcome and self.step >= math.ceil(odd.time_limit):
                self.end(TIME_UP)
        return self.drive

    def end(self, outcome: int) -> None:
        self.drive.outcome = outcome
        self.record()

    def record(self) -> None:
        self.drive.frames.append([replace(vehicle) for vehicle in self.world.vehicles])

    def decide(self) -> None:
        """Everybody decides on the same picture of the world; then all begin to act."""
        simulator, world, drive = self.simulator, self.world, self.drive
        steers = simulator.adversary is None or self.step >= simulator.steers_from
        critical = world.nearest_bv() if steers else None
        self.controlled = critical if simulator.adversary else None
        av_wish = simulator.av_wish(world)
        possible = None if critical is None else simulator.probabilities(world, critical, av_wish[1], attentive=False)
        self.looked_away.clear()
        actions = {bv.slot: self.choose(bv) for bv in world.bvs()}
        if not simulator.idm_bvs:
            self.give_way(actions, av_wish[1])
            for bv, quantile in [(bv, self.quantile_of(bv, actions[bv.slot])) for bv in world.bvs()]:
                bv.quantile, bv.away = quantile, bv.slot in self.looked_away
        for bv in world.bvs():
            bv.act(actions[bv.slot], simulator.odd)
        self.av_acts(av_wish)
        drive.actions.append(actions)
        drive.critical.append(-1 if critical is None else critical.slot)
        drive.probability.append(1.0 if critical is None or possible is None else possible[actions[critical.slot]])

    def av_acts(self, wish: tuple[float, int]) -> None:
        av = self.world.av
        av.hold(wish[0], self.simulator.odd)
        if wish[1] != av.target_lane:
            av.change_lane(wish[1], self.simulator.odd)

    def choose(self, bv: Vehicle) -> Action:
        simulator, world = self.simulator, self.world
        if simulator.adversary is not None and bv is self.controlled:
            adversary = ADVERSARIES[simulator.adversary]
            allowed = simulator.allowed(world, bv, self.budget_left)
            action = adversary(world, bv, allowed, draws(self.stream, self.step, bv.slot))
            if self.budget_left is not None:
                chances = simulator.probabilities(world, bv, world.av.target_lane, attentive=False)
                self.budget_left -= simulator.price(chances, action)
                if simulator.excess:
                    self.budget_left = min(self.budget_left, round((simulator.budget or 0.0) * 1e6))
            return action
        if simulator.idm_bvs:
            command = simulator.idm_behind_all(world, bv, bv.lanes, HUMAN)
            return 2 + bv.can(min(max(math.floor((command + 4.0) * 5.0 + 0.5), 0), 30))
        if self.draw_of_looking(bv) < simulator.chance_to_look_away(bv):
            self.looked_away.add(bv.slot)
            return HOLD
        left, right = simulator.side_chances(world, bv, simulator.model.overlook)
        draw = unit(self.stream.words(self.step, bv.slot, DECIDE)[0])
        if draw < left:
            return 0
        return 1 if draw < left + right else self.drawn_acceleration(bv)

    def draw_of_looking(self, bv: Vehicle) -> float:
        """The low halves of the third and the fourth word make one."""
        _, _, third, fourth = self.stream.words(self.step, bv.slot, DECIDE)
        return unit(third % 2**16 + fourth % 2**16 * 2**16)

    def drawn_acceleration(self, bv: Vehicle) -> Action:
        rounding = self.stream.words(self.step, bv.slot, DECIDE)[3]
        word = look_up_word(self.word_of_acceleration(bv), bv.noise)
        return 2 + bv.can(min(row.draw(word) for row in self.simulator.rows(self.world, bv, unit(rounding))))

    def word_of_acceleration(self, bv: Vehicle) -> int:
        """The random word of a natural driver's acceleration, which a follower remembers."""
        word = self.stream.words(self.step, bv.slot, DECIDE)[1]
        if self.simulator.follows(self.world, bv):
            return self.simulator.tables.remember(word, bv.quantile, bv.habit)
        return word

    def quantile_of(self, bv: Vehicle, action: Action) -> float:
        """Where among the accelerations that it would show in this state that of a BV was.

        Of a lane change nothing is known but the random word. Of an acceleration that an adversary chose it is known
        between which words a natural driver would have drawn it; the random word says where between them.
        """
        if bv is not self.controlled:
            return bv.quantile if bv.slot in self.looked_away else unit(self.word_of_acceleration(bv))
        _, word, _, rounding = self.stream.words(self.step, bv.slot, DECIDE)
        if action >= 2:
            cuts = words_of(self.simulator.rows(self.world, bv, unit(rounding)), action - 2, bv)
            low, high = (rank_of(cut / 2**32, bv.noise) * 2**32 for cut in cuts)
            away = self.simulator.chance_to_look_away(bv)
            looked_away = away / (away + (1.0 - away) * (high - low) / 2**32) if action == HOLD and away else 0.0
            if self.draw_of_looking(bv) < looked_away:
                self.looked_away.add(bv.slot)
                return bv.quantile
            word = math.floor(low + (high - low) * unit(word))
        return unit(word)

    def give_way(self, actions: dict[int, Action], av_lane: int) -> None:
        """From the front to the rear: who starts into the lane that one ahead starts into, may have to wait.

        The controlled BV never waits; others overlook the conflict with a small chance.
        """
        goals = {slot: {0: 1, 1: -1}.get(action, 0) for slot, action in actions.items()}
        goals[0] = av_lane - self.world.av.target_lane
        # at the same x the larger slot is ahead
        for bv in sorted(self.world.bvs(), key=lambda v: (-v.x, -v.slot)):
            if bv is self.controlled or not goals[bv.slot] or bv.path is not None:  # who turns back does not wait
                continue
            lane = bv.target_lane + goals[bv.slot]
            rivals = [
                other
                for other in [self.world.av, *self.world.bvs()]
                if goals[other.slot]
                and other.target_lane + goals[other.slot] == lane
                and (other.x, other.slot) > (bv.x, bv.slot)
                and other.x - bv.x < SIGHT
            ]
            chance = min((self.simulator.chance_to_go_too(self.world, bv, other) for other in rivals), default=1.0)
            overlook = self.simulator.model.overlook_conflict
            draw = unit(self.stream.words(self.step, bv.slot, DECIDE)[2])
            if chance < 1.0 and draw >= overlook + (1.0 - overlook) * chance:
                goals[bv.slot] = 0
                actions[bv.slot] = self.drawn_acceleration(bv)

    def move_for_a_second(self) -> None:
        odd, world = self.simulator.odd, self.world
        pairs = list(combinations(world.from_rear_to_front(), 2))
        for substep in range(10):
            if substep > 0 and substep % odd.av_substeps == 0:
                self.av_acts(self.simulator.av_wish(world))
            self.record()
            for vehicle in world.vehicles:
                if vehicle.present:
                    vehicle.move(odd)
            self.look_for_contacts(pairs)
            if not self.drive.outcome and world.av.x >= odd.av_start + odd.test_length:
                self.drive.outcome = COMPLETED
            if self.drive.outcome:
                self.record()
                return

    def look_for_contacts(self, pairs: list[tuple[Vehicle, Vehicle]]) -> None:
        """A crash of the AV ends the test, else one of the controlled BV; else BVs in contact are counted and removed.

        Pairs are looked at from the rear to the front, by their places when the second began; the first counts.
        """
        boxes = {vehicle.slot: vehicle.box() for vehicle in self.world.vehicles}
        contacts = [
            sorted(pair, key=lambda vehicle: vehicle.slot)
            for pair in pairs
            if all(vehicle.present for vehicle in pair) and boxes[pair[0].slot].overlaps(boxes[pair[1].slot])
        ]
        for outcome, culprit in ((AV_CRASH, self.world.av), (BV_CRASH, self.controlled)):
            for first, second in contacts:
                if culprit in (first, second) and not self.drive.outcome:
                    self.drive.outcome, self.drive.contact = outcome, (first.slot, second.slot)
        if self.drive.outcome:
            self.drive.bv_crashes += self.drive.outcome == BV_CRASH
            return
        for first, second in contacts:
            if first.present and second.present:
                self.drive.bv_crashes += 1
                first.present = second.present = False
