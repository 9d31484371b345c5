"""Sixteen strangers: twelve AVs with one flaw each, three without, and SUMO's Krauss. See README.md beside this file.

All share one sound way of driving (`Sound`): it follows by the IDM, softened by the constant-acceleration heuristic of
Kesting, Treiber and Helbing (2010); it gives way to whoever moves into its lane; and it looks ahead, beside, behind and
two lanes over before and during a lane change. Each flawed class spoils exactly one thing of that.
"""

# ruff: noqa: ARG002 - what is spoilt decides for itself what it reads

import numpy as np

OFTEN = 10  # answers a second, unless setup says otherwise


def dice(*parts):
    """Numbers in [0, 1) that depend on the whole numbers given, and on nothing else (splitmix64)."""
    h = np.asarray(np.uint64(0x9E3779B97F4A7C15))
    with np.errstate(over="ignore"):
        for part in parts:
            h = (np.asarray(part).astype(np.int64).astype(np.uint64) ^ h) + np.uint64(0x9E3779B97F4A7C15)
            h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            h = h ^ (h >> np.uint64(31))
    return (h >> np.uint64(11)) / float(1 << 53)


class Scene:
    """The view in names. Of the AV: (B, 1); of the others: (B, 12)."""

    def __init__(self, view, car):
        view = np.asarray(view, dtype=float)
        me, them = view[:, :1], view[:, 1:]
        self.on = me[:, :, 0] == 1
        self.y, self.v, self.vy = me[..., 2], me[..., 3], me[..., 4]
        self.lane, self.changing = np.rint(me[..., 6]), me[..., 7] > 0.5
        self.there = them[..., 0] == 1
        self.x, self.dy = them[..., 1], them[..., 2]
        self.ov, self.ovy, self.oa = them[..., 3], them[..., 4], them[..., 5]
        self.olane, self.ochanging = np.rint(them[..., 6]), them[..., 7] > 0.5
        self.oy = self.y + self.dy
        self.gap = np.abs(self.x) - car.length  # between bumpers
        self.here = np.floor(self.y / car.lane_width)  # lane that my centre is in
        self.centre_lane = np.floor(self.oy / car.lane_width)
        # whoever moves sideways towards me
        self.coming = self.there & (self.dy * (self.ovy - self.vy) < 0)


class Sound:
    desired, headway, standstill = 33.0, 1.5, 2.0  # m/s, s, m
    strong, comfort = 1.6, 2.2  # m/s2
    changes, profit = True, 0.35  # m/s2 that a change must bring
    front_time, rear_time = 0.7, 0.7  # s of gap that a change must leave

    def setup(self, context):
        self.length, self.width = context.vehicle_length, context.vehicle_width
        self.lane_width, self.lanes = context.lane_width, context.n_lanes
        self.rate = 1.0 / context.interval if context.interval else OFTEN

    # -- seeing: what the flawed ones spoil ------------------------------------------------------------------------

    def look(self, view):
        return Scene(view, self)

    def in_my_way(self, s):
        """Vehicles ahead that I have to follow: in my path, in the lane I keep or change to, or about to be."""
        overlap = np.abs(s.dy) < self.width + 0.2
        mine = s.olane == s.lane
        soon = (
            s.coming & (np.abs(s.dy + 1.0 * (s.ovy - s.vy)) < self.width + 0.2) & (np.abs(s.dy) < 1.2 * self.lane_width)
        )
        return s.there & (s.x > 1.0) & (overlap | mine | soon)

    def users(self, s, lane):
        """Vehicles that a change to `lane` has to reckon with."""
        left, right = (lane + 1) * self.lane_width, lane * self.lane_width
        half = self.width / 2
        body = (s.oy - half < left) & (s.oy + half > right)
        later = s.oy + 2.0 * s.ovy
        soon = (later - half < left - 0.2) & (later + half > right + 0.2) & (np.abs(s.ovy) > 0.1)
        return s.there & (body | soon | (s.olane == lane))

    # -- following -------------------------------------------------------------------------------------------------

    def free(self, v):
        a = self.strong * (1 - (v / self.desired) ** 4)
        return np.maximum(a, -1.5)

    def behind_one(self, s):
        """(B, 12): the acceleration that following each of the others would ask for."""
        v, u = s.v, s.ov
        gap = np.maximum(np.where(s.x > 0, s.gap, 1e3), 0.5)
        closing = v - u
        want = self.standstill + np.maximum(
            self.headway * v + v * closing / (2 * np.sqrt(self.strong * self.comfort)), 0
        )
        idm = np.minimum(self.free(v), self.strong * (1 - (v / self.desired) ** 4 - (want / gap) ** 2))
        theirs = np.minimum(s.oa, self.strong)
        below = u * u - 2 * gap * theirs
        stops = (u * closing <= -2 * gap * theirs) & (below > 1e-3)
        heuristic = np.where(
            stops, v * v * theirs / np.where(stops, below, 1.0), theirs - np.maximum(closing, 0) ** 2 / (2 * gap)
        )
        soft = 0.05 * idm + 0.95 * (heuristic + self.comfort * np.tanh((idm - heuristic) / self.comfort))
        a = np.where(idm >= heuristic, idm, soft)
        # nose beside me and not yet in my path: fall back, without standing on the brakes
        beside = (s.gap < 0) & (np.abs(s.dy) > self.width)
        return np.where(beside, np.maximum(a, -3.0), a)

    def follow(self, s):
        each = np.where(self.in_my_way(s), self.behind_one(s), np.inf)
        return np.minimum(each.min(axis=1), self.free(s.v[:, 0]))

    # -- changing lanes --------------------------------------------------------------------------------------------

    def clear(self, s, lane):
        """Is there room in `lane` ahead, beside and behind?"""
        users = self.users(s, lane)
        closing = np.where(s.x > 0, s.v - s.ov, s.ov - s.v)
        time = np.where(s.x > 0, self.front_time * s.v, self.rear_time * s.ov)
        need = 2.0 + time + 1.5 * np.maximum(closing, 0) + np.maximum(closing, 0) ** 2 / (2 * 2.0)
        return ~(users & (s.gap < need)).any(axis=1)

    def worth(self, s, lane):
        ahead = self.users(s, lane) & (s.x > 0)
        each = np.where(ahead, self.behind_one(s), np.inf)
        return np.minimum(each.min(axis=1), self.free(s.v[:, 0]))

    def start(self, s, now):
        """Lane order of those that keep their lane."""
        order, best = np.zeros(len(now)), now + self.profit
        for side in (1, -1):
            lane = s.lane + side
            exists = ((lane >= 0) & (lane < self.lanes))[:, 0]
            value = self.worth(s, lane)
            good = exists & (value > best) & self.clear(s, lane)
            order, best = np.where(good, side, order), np.where(good, value, best)
        return order

    def back(self, s):
        """Should a change that has not crossed the line be given up?"""
        users = self.users(s, s.lane)
        closing = np.where(s.x > 0, s.v - s.ov, s.ov - s.v)
        tight = s.gap < 1.0 + 1.0 * np.maximum(closing, 0) + np.maximum(closing, 0) ** 2 / (2 * 4.0)
        return (users & tight & (np.abs(s.dy) > self.width)).any(axis=1)

    def steer(self, s, now):
        if not self.changes:
            return np.zeros(len(now))
        toward = (s.lane - s.here)[:, 0]  # not 0: the line is still to be crossed
        crossing = s.changing[:, 0] & (toward != 0)
        order = np.where(s.changing[:, 0], 0.0, self.start(s, now))
        return np.where(crossing & self.back(s), -np.sign(toward), order)

    # -- all together ----------------------------------------------------------------------------------------------

    def act(self, view):
        s = self.look(view)
        a = self.follow(s)
        order = self.steer(s, a)
        a, order = self.spoil(s, a, order)
        a = np.clip(np.nan_to_num(a), -8.0, 2.0)
        return np.where(s.on, np.stack([a, order], axis=1), 0.0)

    def spoil(self, s, a, order):
        return a, order


class Remembering(Sound):
    """For those that need the time in the test and numbers drawn by its seed."""

    def setup(self, context):
        super().setup(context)
        self.clock = np.full(context.batch, -1, dtype=np.int64)  # answers since the test began
        self.seed = np.zeros(context.batch, dtype=np.int64)
        self.memory(context.batch)

    def memory(self, batch):
        pass

    def forget(self, worlds):
        pass

    def reset(self, worlds, seeds):
        self.clock[worlds] = -1
        self.seed[worlds] = np.asarray(seeds, dtype=np.int64)
        self.forget(worlds)

    def act(self, view):
        self.clock += np.asarray(view)[:, 0, 0] == 1
        return super().act(view)

    def spell(self, every, lasts, chance, name):
        """True during spells of `lasts` seconds: in each `every` seconds there is one with this chance."""
        every, lasts = round(every * self.rate), max(round(lasts * self.rate), 1)
        period, at = np.maximum(self.clock, 0) // every, np.maximum(self.clock, 0) % every
        begin = np.floor(dice(self.seed, period, name) * (every - lasts + 1))
        return (dice(self.seed, period, name + 1) < chance) & (at >= begin) & (at < begin + lasts)


# ---- twelve with a flaw ----------------------------------------------------------------------------------------------


class CutInSleeper(Sound):
    """Takes a vehicle that cuts in for its leader only when that vehicle is almost in the middle of the lane."""

    def in_my_way(self, s):
        settled = ~s.ochanging & (s.olane == s.lane) & (np.abs(s.ovy) < 0.1)  # counts for changes of my own
        return s.there & (s.x > 1.0) & ((np.abs(s.dy) < 0.9) | (s.changing & settled))


class SoftPedal(Sound):
    """Never brakes harder than 2 m/s2, whatever happens."""

    def spoil(self, s, a, order):
        return np.maximum(a, -2.0), order


class GhostBraker(Remembering):
    """Brakes with 6 m/s2 for 1.2 s for nothing, in each 8 s with even chances."""

    def spoil(self, s, a, order):
        return np.where(self.spell(8.0, 1.2, 0.5, 10), np.minimum(a, -6.0), a), order


class SideTwitcher(Remembering):
    """Now and then steers at the neighbour beside it for 1.3 s, then catches itself."""

    def memory(self, batch):
        self.left, self.side = np.zeros(batch, dtype=np.int64), np.zeros(batch)

    def forget(self, worlds):
        self.left[worlds], self.side[worlds] = 0, 0.0

    def in_my_way(self, s):
        swerving = (self.left > 0)[:, None] | (s.changing & (s.lane == s.here))
        s.lane, kept = np.where(swerving, s.here, s.lane), s.lane  # the swerve is no change of lanes
        stranger = swerving & (np.abs(s.dy) > self.width) & (s.olane != s.here)
        way = super().in_my_way(s) & ~stranger  # nor does it brake for whom it swerves at
        s.lane = kept
        return way

    def spoil(self, s, a, order):
        beside = s.there & (np.abs(s.x) < 9.0) & ~s.ochanging & (np.abs(np.abs(s.dy) - self.lane_width) < 1.0)
        nearest = np.where(beside, np.abs(s.x), np.inf).argmin(axis=1)
        side = np.sign(s.dy[np.arange(len(a)), nearest])
        begins = self.spell(2.5, 1.0, 0.7, 20) & beside.any(axis=1) & ~s.changing[:, 0] & (self.left == 0)
        self.side = np.where(begins, side, self.side)
        self.left = np.where(begins, round(1.3 * self.rate), self.left)
        going, last = self.left > 0, self.left == 1
        order = np.where(going, self.side, order)
        order = np.where(last, -self.side, order)
        self.left = np.maximum(self.left - s.on[:, 0], 0)
        return a, order


class BumperHugger(Sound):
    """Tailgates: follows 0.35 s behind, and closes up to it briskly."""

    headway, standstill, strong, comfort, desired, profit = 0.35, 1.5, 2.0, 5.0, 48.0, 1.0

    def spoil(self, s, a, order):
        return np.minimum(a, 0.6 * (37.0 - s.v[:, 0])), order  # its speed on a free road


class GateCloser(Sound):
    """Speeds up when somebody ahead moves over into its lane, and yields only when the other is in front of it."""

    def rivals(self, s):
        merging = s.coming & (np.abs(s.ovy) > 0.15) & (np.abs(s.dy) > 1.3) & (np.abs(s.dy) < 1.1 * self.lane_width)
        return merging & (s.x > -3.0) & (s.x < 45.0) & ~s.changing

    def in_my_way(self, s):
        return super().in_my_way(s) & ~self.rivals(s)

    def spoil(self, s, a, order):
        race = self.rivals(s).any(axis=1)
        return np.where(race & (a > -1.0) & (s.v[:, 0] < 38.0), 2.0, a), np.where(race, 0.0, order)


class HalfwayQuitter(Remembering):
    """Gives up most of its lane changes astride the line, for no reason, and goes back."""

    profit, desired = 0.15, 35.0

    def memory(self, batch):
        self.tries, self.wait = np.zeros(batch, dtype=np.int64), np.zeros(batch, dtype=np.int64)

    def forget(self, worlds):
        self.tries[worlds], self.wait[worlds] = 0, 0

    def spoil(self, s, a, order):
        order = np.where(~s.changing[:, 0] & (self.wait > 0), 0.0, order)
        self.wait = np.maximum(self.wait - s.on[:, 0], 0)
        self.tries = self.tries + ((order != 0) & ~s.changing[:, 0])
        toward = (s.lane - s.here)[:, 0]
        off = np.abs((s.lane + 0.5) * self.lane_width - s.y)[:, 0]
        astride = s.changing[:, 0] & (toward != 0) & (off < 0.5 * self.lane_width + 0.35)
        quits = astride & (dice(self.seed, self.tries, 30) < 0.8)
        self.wait = np.where(quits, round(4.0 * self.rate), self.wait)
        return a, np.where(quits, -np.sign(toward), order)


class ForwardOnly(Sound):
    """Changes lanes by what is ahead alone: it looks neither beside nor behind."""

    profit, desired = 0.15, 35.0

    def users(self, s, lane):
        return super().users(s, lane) & (s.x > self.length)


class TwoOverBlind(Sound):
    """Before and during a lane change it does not reckon with vehicles that come into that lane from the far side."""

    profit, desired = 0.15, 35.0

    def far(self, s):
        """Not in the lane next to mine, or the one I change to, but beyond."""
        towards = np.where(s.changing & (s.lane != s.here), s.lane, s.here)
        beyond = np.abs(s.centre_lane - s.here) >= 2
        return beyond | (s.changing & (s.here != towards) & (s.centre_lane != s.here) & (s.centre_lane != towards))

    def users(self, s, lane):
        return s.there & (s.centre_lane == lane) & ~self.far(s)

    def in_my_way(self, s):
        return super().in_my_way(s) & ~(self.far(s) & (np.abs(s.dy) > self.width))


class TrackDropper(Remembering):
    """Loses the vehicle that it follows for 2.5 s, again and again, and drives as if the lane were free."""

    def in_my_way(self, s):
        seen = super().in_my_way(s)
        nearest = np.where(seen, s.x, np.inf).argmin(axis=1)
        lost = self.spell(4.5, 2.5, 0.75, 40)[:, None] & (np.arange(seen.shape[1]) == nearest[:, None])
        return seen & ~lost


class ClosingMisjudge(Sound):
    """Judges every speed difference above 3 m/s as 3 m/s: large ones are seen far too small, ahead and behind."""

    def look(self, view):
        s = super().look(view)
        s.ov = np.where(s.there, s.v + np.clip(s.ov - s.v, -3.0, 3.0), s.ov)
        return s


class CutInPanic(Sound):
    """Slams on the brakes whenever a vehicle moves into its lane within 70 m ahead, even if far away and faster."""

    def spoil(self, s, a, order):
        enters = s.ochanging & (s.olane == s.lane) & s.coming & (np.abs(s.dy) > 1.2) & (np.abs(s.ovy) > 0.1)
        scared = (enters & (s.x > 0) & (s.x < 70.0) & ~s.changing).any(axis=1)
        return np.where(scared, -7.5, a), np.where(scared, 0.0, order)


# ---- three without ---------------------------------------------------------------------------------------------------


class Cautious(Sound):
    """Slow and far behind, changes lanes seldom and only into large gaps."""

    desired, headway, standstill, strong, comfort = 29.0, 2.2, 4.0, 1.2, 1.6
    profit, front_time, rear_time = 0.8, 1.4, 1.4


class Brisk(Sound):
    """Fast and closer, overtakes readily, looks as carefully as anyone."""

    desired, headway, standstill, strong, comfort = 37.0, 1.1, 2.0, 2.0, 2.5
    profit, front_time, rear_time = 0.15, 0.6, 0.6


class LaneKeeper(Sound):
    """Keeps its lane, follows at 1.6 s."""

    changes, headway = False, 1.6


# ---- SUMO ------------------------------------------------------------------------------------------------------------


class Krauss:
    """Krauss (1998): v_safe = v_l + (g - v_l tau) / ((v + v_l) / (2 b) + tau), v_next = min(v_max, v + a dt, v_safe).

    SUMO's defaults, without dawdling (sigma 0), keeps its lane. The leader is the nearest vehicle ahead whose lane is
    mine or whose body is over my lane.
    """

    tau, accel, decel, min_gap, limit = 1.0, 2.6, 4.5, 2.5, 33.0

    def setup(self, context):
        self.length, self.width, self.lane_width = context.vehicle_length, context.vehicle_width, context.lane_width
        self.dt = context.interval

    def act(self, view):
        view = np.asarray(view, dtype=float)
        me, them = view[:, 0], view[:, 1:]
        over = np.abs(them[..., 2]) < (self.lane_width + self.width) / 2
        lead = (them[..., 0] == 1) & (them[..., 1] > 0) & (over | (np.rint(them[..., 6]) == np.rint(me[:, 6:7])))
        x = np.where(lead, them[..., 1], np.inf)
        first, rows = x.argmin(axis=1), np.arange(len(view))
        v, vl = me[:, 3], them[rows, first, 3]
        x = x[rows, first]
        g = np.where(np.isfinite(x), np.maximum(x - self.length - self.min_gap, 0.0), 1e4)
        safe = vl + (g - vl * self.tau) / ((v + vl) / (2 * self.decel) + self.tau)
        nxt = np.minimum(np.minimum(self.limit, v + self.accel * self.dt), np.where(np.isfinite(x), safe, np.inf))
        a = np.clip((np.maximum(nxt, 0.0) - v) / self.dt, -8.0, 2.0)
        return np.where(me[:, :1] == 1, np.stack([a, np.zeros_like(a)], axis=1), 0.0)
