"""Two AVs of your own for junctions: one that yields, and one that overlooks people behind stopped vehicles. Try them:

cornerforge check-av --site mcity-signal junction_av.py:MyAv
cornerforge simulate --site mcity-signal --av junction_av.py:MyAv --tests 1000
"""

import numpy as np

RED, YELLOW = 1, 2
PERSON = 3
HEADWAY, STANDSTILL, STRENGTH, BRAKES = 1.5, 2.0, 1.5, 2.0  # IDM: s, m, m/s2, m/s2
GAP = 2.0  # seconds that it leaves before and behind others
ASIDE = 0.5  # metres that it leaves beside them


def follow(speed, room, lead=0.0):
    """Acceleration behind something that is `room` ahead and drives at `lead` (IDM); -8 where there is no room."""
    wished = STANDSTILL + np.maximum(0.0, HEADWAY * speed + speed * (speed - lead) / (2 * np.sqrt(STRENGTH * BRAKES)))
    return np.maximum(STRENGTH * (1 - (wished / np.maximum(room, 0.1)) ** 2), -8.0)


class MyAv:
    """Follows, stops for red, and enters only where none that goes first comes in the next seconds."""

    interface = 2  # it answers for many worlds at once
    answers = "acceleration"
    objects = 16  # so many of the nearest agents it sees

    def act(self, scenes):
        speed, moment, path, agents = scenes.own.vx, scenes.moment, scenes.path, scenes.agents
        front = 0.5 * scenes.own.length
        command = np.clip(path.limit[:, 0] - speed, -3.0, STRENGTH)
        # the light: stop if that is possible
        room = moment.to_stop_line
        stops = (moment.light == RED) | (moment.light == YELLOW)
        stops &= (room > -0.5) & (speed**2 < 2 * 4.0 * np.maximum(room, 0.2))
        command = np.where(stops, np.minimum(command, follow(speed, room + STANDSTILL - 1.0)), command)
        # where agents are as the points of the path see it, if they go straight on: (B, N, 20)
        heed = self.heeded(agents, moment.time)[..., None]
        dx = path.x[:, None] - agents.x[..., None]
        dy = path.y[:, None] - agents.y[..., None]
        cosine, sine = np.cos(agents.heading)[..., None], np.sin(agents.heading)[..., None]
        ahead, aside = dx * cosine + dy * sine, np.abs(dy * cosine - dx * sine)
        pace = np.hypot(agents.vx, agents.vy)[..., None]
        reach = 0.5 * agents.length[..., None] + 0.5 * scenes.own.width[:, None, None] + ASIDE
        meets = heed & (aside < 0.5 * (agents.width[..., None] + scenes.own.width[:, None, None]) + ASIDE)
        meets &= ahead > -reach
        comes = np.maximum(ahead - reach, 0.0) / np.maximum(pace, 0.1)
        leaves = (ahead + reach) / np.maximum(pace, 0.1)
        # leaders: vehicles that are on the path now and drive along it
        s = 2.0 * np.arange(1, 21)
        along = np.cos(agents.heading[..., None] - path.heading[:, None]) > 0.7
        person = (agents.kind == PERSON)[..., None]
        leads = heed & ~person & along & (dx**2 + dy**2 < 1.5**2)
        gap = np.where(leads, s - 0.5 * agents.length[..., None] - front[:, None, None], np.inf).min(axis=2)
        nearest = gap.argmin(axis=1)
        rows = np.arange(len(speed))
        lead = np.where(np.isfinite(gap[rows, nearest]), agents.vx[rows, nearest], 0.0)
        command = np.minimum(command, follow(speed, gap.min(axis=1), lead))
        # others: stop before the first point at which one could be when it is there itself
        enters = np.maximum(s - front[:, None] - 1.0, 0.0) / np.maximum(speed, 3.0)[:, None]
        is_out = enters + (2 * front + 2.0)[:, None] / np.maximum(speed, 3.0)[:, None]
        comes_between = (comes < is_out[:, None] + GAP) & (leaves > enters[:, None] - 1.0)
        first = (agents.priority > 0)[..., None] | person
        cannot_stop = comes < 0.5 * pace / 4.0 + 0.5  # without priority it is thought to stop while it can
        conflict = meets & ~(leads.any(axis=2)[..., None] & along) & comes_between & (first | cannot_stop)
        conflict &= (s > front[:, None])[:, None]  # what it has reached it leaves
        stop = np.where(conflict.any(axis=1), s - front[:, None] - ASIDE, np.inf).min(axis=1)
        return np.minimum(command, follow(speed, stop + STANDSTILL - 1.0))

    def heeded(self, agents, time):
        """Which agents it heeds, (B, N)."""
        return agents.there


class MyHastyAv(MyAv):
    """The same with a flaw: its camera does not see through vehicles, and its tracker believes in a person only after a
    second in sight. It overlooks people who come out from behind a stopped truck."""

    def reset(self, worlds, seeds):
        self.since[worlds] = np.inf

    def setup(self, context):
        self.since = np.full((context.batch, 1024), np.inf)  # since when each agent is in sight [s]

    def heeded(self, agents, time):
        rows = np.arange(len(time))[:, None]
        number = np.where(agents.there, agents.id, 1023)
        seen = agents.there & ~self.hidden(agents)
        since = np.where(seen, np.minimum(self.since[rows, number], time[:, None]), np.inf)
        self.since[:] = np.inf
        self.since[rows, number] = since
        return agents.there & ((agents.kind != PERSON) | (time[:, None] - since >= 1.0))

    def hidden(self, agents):
        """Is the line from the AV to an agent's middle cut by the box of a vehicle, (B, N)?"""
        cosine, sine = np.cos(agents.heading)[:, None], np.sin(agents.heading)[:, None]
        x, y = agents.x[:, :, None], agents.y[:, :, None]
        ox, oy = agents.x[:, None], agents.y[:, None]
        # the line from (0, 0) to (x, y) in the frame of each other box, cut to its sides
        at = (-ox * cosine - oy * sine, ox * sine - oy * cosine)
        way = (x * cosine + y * sine, y * cosine - x * sine)
        enters, leaves = np.zeros(x.shape), np.ones(x.shape)
        for start, go, half in zip(at, way, (0.5 * agents.length[:, None], 0.5 * agents.width[:, None])):
            go = np.where(np.abs(go) < 1e-9, 1e-9, go)
            one, other = (-half - start) / go, (half - start) / go
            enters, leaves = np.maximum(enters, np.minimum(one, other)), np.minimum(leaves, np.maximum(one, other))
        cuts = (enters < leaves) & ((agents.kind != PERSON) & agents.there)[:, None]
        return (cuts & ~np.eye(agents.x.shape[1], dtype=bool)).any(axis=2)
