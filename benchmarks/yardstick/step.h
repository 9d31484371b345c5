/* src/cornerforge/sim/reach.py and sim/step.py, without recording. */
#ifndef YARDSTICK_STEP_H
#define YARDSTICK_STEP_H

#include "decide.h"

enum { SUBSTEPS = 10, UNSURE = 1 };
#define FULL_STEERING_SPEED 5.0
#define HARDEST_BRAKING 12.0
#define STRONGEST_ACCELERATION 10.0
#define ROUNDING 0.01

static inline double met_after(double room, double rate, double growth) {
    double square = rate * rate + 2.0 * growth * room, root = sqrt(MAX(0.0, square));
    return rate > 0.0 ? 2.0 * room / (root + rate) : (root - rate) / growth;
}

static inline double way_in_ramp(double start, double a, double jerk, double time) {
    return time * (start + time * (0.5 * a + (1.0 / 6.0) * jerk * time));
}

static double ramp_through(double *speed, double a, double jerk, double time, double max_speed) {
    double gone = 0.0, start = *speed, turn = -a / jerk, extreme = start + 0.5 * a * turn, until, limit;
    if (0.0 < turn && turn < time && !(0.0 <= extreme && extreme <= max_speed)) {
        limit = a < 0.0 ? 0.0 : max_speed;
        until = a < 0.0 ? met_after(start, -a, -jerk) : met_after(max_speed - start, a, jerk);
        gone = way_in_ramp(start, a, jerk, until) + limit * (turn - until);
        start = limit;
        a = 0.0;
        time = time - turn;
    }
    double after = start + time * (a + 0.5 * jerk * time);
    if (0.0 <= after && after <= max_speed) {
        *speed = after;
        return gone + way_in_ramp(start, a, jerk, time);
    }
    limit = after < 0.0 ? 0.0 : max_speed;
    until = after < 0.0 ? met_after(start, -a, -jerk) : met_after(max_speed - start, a, jerk);
    *speed = limit;
    return gone + (way_in_ramp(start, a, jerk, until) + limit * (time - until));
}

static void move_vehicle(Vehicle *v, double held, const Road *road) {
    double start = v->speed_held, a = v->acceleration_held, command = v->commanded, time = held, gone = 0.0;
    double at_top = 0.0, now = command, ramp = fabs(command - a) * road->ramp_time;
    if (ramp > 0.0) {
        double jerk = command > a ? road->max_jerk : -road->max_jerk, within = MIN(time, ramp);
        if (time < ramp) now = a + jerk * time;
        gone = ramp_through(&start, a, jerk, within, road->max_speed);
        time -= within;
    }
    double after = start + command * time;
    if (after < 0.0) {
        gone += -0.5 * start * start / command;
        after = 0.0;
    } else if (after > road->max_speed) {
        double until = (road->max_speed - start) / command;
        gone += 0.5 * (start + road->max_speed) * until;
        at_top = road->max_speed * (time - until);
        after = road->max_speed;
    } else {
        gone += 0.5 * (start + after) * time;
    }
    if (road->ramp_time > 0.0 && ((after == 0.0 && now < 0.0) || (after == road->max_speed && now > 0.0))) now = 0.0;
    v->x = v->x_held + gone;
    v->x = v->x + at_top;
    v->acceleration = now;
    v->speed = after;
    if (v->duration == 0.0) return;
    double slow = after / FULL_STEERING_SPEED, pace = MIN(1.0, slow);
    v->clock += DT * pace;
    if (v->clock >= v->duration - 1e-9) {
        v->y = lane_centre(v->target_lane, road->lane_width);
        v->lateral_speed = 0.0;
        v->heading = 0.0;
        v->duration = 0.0;
    } else {
        v->y = path_position(v->c, v->clock);
        v->lateral_speed = path_speed(v->c, v->clock) * pace;
        if (after > 0.0) v->heading = arctangent(v->lateral_speed / after);
    }
    v->lanes = lane_bits(v->y, 0.5 * road->width, v->target_lane, road->lane_width);
}

static inline double lateral_reach(const World *w, int64_t i, const Road *road) {
    if (i > 0 && w->v[i].duration == 0.0) return 0.0;
    return w->v[i].change_time >= 2.0 ? road->lane_width : 2.0 * road->lane_width;
}

static void bound_motion(const World *w, double braking, double acceleration, Pairs *pairs) {
    const Vehicle *v = w->v;
    for (int64_t i = 0; i < w->info[N_VEHICLES]; i++) {
        pairs->least[i] = v[i].speed + 0.5 * MIN(0.0, MIN(v[i].commanded, v[i].acceleration));
        pairs->most[i] = v[i].speed + 0.5 * MAX(0.0, MAX(v[i].commanded, v[i].acceleration));
    }
    pairs->least[0] = v[0].speed - 0.5 * MAX(braking, -v[0].acceleration);
    pairs->most[0] = v[0].speed + 0.5 * MAX(acceleration, v[0].acceleration);
}

static int64_t find_pairs(const World *w, const Road *road, Pairs *pairs) {
    const Vehicle *v = w->v;
    const int64_t *order = w->order, n = w->info[N_VEHICLES];
    int64_t found = 0;
    double least = INFINITY;
    for (int64_t i = 0; i < n; i++)
        if (v[i].present) least = MIN(least, pairs->least[i]);
    for (int64_t rank = 0; rank < n; rank++) {
        int64_t i = order[rank];
        if (v[i].present == 0) continue;
        double reach = lateral_reach(w, i, road), faster = pairs->most[i] - least;
        double limit = road->length + 1.0 + MAX(0.0, faster);
        for (int64_t other = rank + 1; other < n; other++) {
            int64_t j = order[other];
            double dx = v[j].x - v[i].x;
            if (dx > limit) break;
            faster = pairs->most[i] - pairs->least[j];
            if (v[j].present == 0 || dx > road->length + 1.0 + MAX(0.0, faster)) continue;
            if (fabs(v[j].y - v[i].y) < road->width + 1.0 + reach + lateral_reach(w, j, road) &&
                found < pairs->capacity) {
                pairs->a[found] = MIN(i, j);
                pairs->b[found] = MAX(i, j);
                found++;
            }
        }
    }
    return found;
}

static inline double falls_back(const Pairs *pairs, int64_t j) {
    double loss = pairs->most[0] - pairs->least[j];
    return MAX(0.0, loss) + ROUNDING;
}

static inline double gains(const Pairs *pairs, int64_t j) {
    double gain = pairs->most[j] - pairs->least[0];
    return MAX(0.0, gain) + ROUNDING;
}

static void bound_av_neighbours(const World *w, Pairs *pairs, const Road *road) {
    const Vehicle *v = w->v;
    for (int64_t lane = 0; lane < road->n_lanes; lane++) pairs->ahead[lane] = pairs->behind[lane] = SIGHT;
    for (int64_t j = 1; j < w->info[N_VEHICLES]; j++) {
        int64_t lane = v[j].target_lane;
        if (v[j].present && pairs->is_watched[j] != UNSURE && v[j].lanes == (int64_t)1 << lane) {
            double dx = v[j].x - v[0].x;
            if (dx > falls_back(pairs, j)) {
                double limit = dx + gains(pairs, j);
                pairs->ahead[lane] = MIN(pairs->ahead[lane], limit);
            } else if (-dx > gains(pairs, j)) {
                double limit = falls_back(pairs, j) - dx;
                pairs->behind[lane] = MIN(pairs->behind[lane], limit);
            }
        }
    }
}

static inline int64_t lanes_to_come(const Vehicle *v) {
    return v->duration > 0.0 && (v->c[1] != 0.0 || v->c[2] != 0.0) ? -1 : v->lanes;
}

static inline bool is_seen(const World *w, int64_t j, const Pairs *pairs, const Road *road) {
    const Vehicle *v = w->v;
    double dx = v[j].x - v[0].x, nearest = dx - falls_back(pairs, j), farthest = dx + gains(pairs, j);
    int64_t own = v[j].target_lane;
    if (v[j].duration == 0.0 && keeps_one_lane(&v[j]))
        return nearest <= pairs->ahead[own] && farthest >= -pairs->behind[own];
    int64_t lanes = lanes_to_come(&v[j]);
    for (int64_t lane = 0; lane < road->n_lanes; lane++)
        if (lanes & ((int64_t)1 << lane) && nearest <= pairs->ahead[lane] && farthest >= -pairs->behind[lane])
            return true;
    return false;
}

static inline void note_av_neighbour(World *w, int64_t j, const Pairs *pairs) {
    const Vehicle *v = w->v;
    int64_t lane = v[j].target_lane, *leads = w->info + AV_LEADS, *rears = w->info + AV_REARS;
    double dx = v[j].x - v[0].x;
    int64_t *spot = dx > 0.0 ? &leads[lane] : &rears[lane];
    if ((-gains(pairs, j) <= dx && dx <= falls_back(pairs, j)) || *spot != -1)
        leads[lane] = UNKNOWN;
    else
        *spot = j;
}

static void choose_current(World *w, Pairs *pairs, int64_t n_pairs, bool everybody, const Road *road) {
    const Vehicle *v = w->v;
    const int64_t n = w->info[N_VEHICLES];
    if (everybody) {
        all_current(w);
        return;
    }
    for (int64_t i = 0; i < n; i++) pairs->is_watched[i] = v[i].duration > 0.0 ? UNSURE : 0;
    for (int64_t k = 0; k < n_pairs; k++) {
        pairs->is_watched[pairs->a[k]] = UNSURE;
        pairs->is_watched[pairs->b[k]] = UNSURE;
    }
    bound_av_neighbours(w, pairs, road);
    for (int64_t lane = 0; lane < road->n_lanes; lane++) w->info[AV_LEADS + lane] = w->info[AV_REARS + lane] = -1;
    w->current[0] = 0;
    int64_t found = 1, unsure = 0;
    for (int64_t j = 1; j < n; j++) {
        if (v[j].present && is_seen(w, j, pairs, road)) {
            pairs->is_watched[j] = 0;
            w->current[found++] = j;
            if (v[j].duration == 0.0 && keeps_one_lane(&v[j]))
                note_av_neighbour(w, j, pairs);
            else
                unsure |= lanes_to_come(&v[j]);
        }
    }
    w->info[N_SEEN] = found;
    for (int64_t lane = 0; lane < road->n_lanes; lane++)
        if (unsure & ((int64_t)1 << lane)) w->info[AV_LEADS + lane] = UNKNOWN;
    for (int64_t j = 1; j < n; j++)
        if (pairs->is_watched[j] && v[j].present) w->current[found++] = j;
    w->info[N_CURRENT] = found;
}

static bool touch(const World *w, int64_t a, int64_t b, const Road *road) {
    const Vehicle *v = w->v;
    if (v[a].present == 0 || v[b].present == 0) return false;
    return boxes_overlap(&v[a], &v[b], road->length, road->width);
}

static void drop_absent(World *w) {
    int64_t kept = 0, seen = 0;
    for (int64_t k = 0; k < w->info[N_CURRENT]; k++) {
        if (w->v[w->current[k]].present) {
            w->current[kept++] = w->current[k];
            if (k < w->info[N_SEEN]) seen = kept;
        }
    }
    w->info[N_CURRENT] = kept;
    w->info[N_SEEN] = seen;
    forget_av_neighbours(w);
}

static bool check_contacts(World *w, const Pairs *pairs, int64_t n_pairs, int64_t frame, const Road *road) {
    int64_t *info = w->info;
    for (int64_t k = 0; k < n_pairs; k++) {
        int64_t a = pairs->a[k], b = pairs->b[k];
        bool is_av = a == 0;
        if (!is_av && (info[OUTCOME] != RUNNING || (info[CONTROLLED] != a && info[CONTROLLED] != b))) continue;
        if (info[OUTCOME] != AV_CRASH && touch(w, a, b, road)) {
            info[OUTCOME] = is_av ? AV_CRASH : BV_CRASH;
            info[SLOT_A] = a;
            info[SLOT_B] = b;
            info[FRAME] = frame;
        }
    }
    if (info[OUTCOME] != RUNNING) {
        if (info[OUTCOME] == BV_CRASH) info[N_BV_CRASHES] += 1;
        return true;
    }
    bool removed = false;
    for (int64_t k = 0; k < n_pairs; k++) {
        int64_t a = pairs->a[k], b = pairs->b[k];
        if (a > 0 && touch(w, a, b, road)) {
            info[N_BV_CRASHES] += 1;
            w->v[a].present = 0;
            w->v[b].present = 0;
            removed = true;
        }
    }
    if (removed) drop_absent(w);
    return false;
}

static void av_acts(World *w, double command, int64_t lane, const Road *road) {
    hold(&w->v[0], command, road);
    if (lane != w->v[0].target_lane) start_lane_change(w, 0, lane, road);
}

static void move(World *w, int64_t substep, const Road *road) {
    if (substep == SUBSTEPS - 1) list_all(w);
    move_vehicle(&w->v[0], (double)(substep % road->av_substeps + 1) * DT, road);
    double held = (double)(substep + 1) * DT;
    for (int64_t k = 1; k < w->info[N_CURRENT]; k++) move_vehicle(&w->v[w->current[k]], held, road);
}

static void step_world(
    World *w, int64_t seed, int64_t test, const Road *road, const Av *av, const Tables *tables,
    const double *accelerations, Pairs *pairs
) {
    Vehicle *v = w->v;
    int64_t *info = w->info, lane;
    const int64_t n = info[N_VEHICLES], first_frame = SUBSTEPS * info[N_DECISIONS];
    double command = av_decide(w, road, av, &lane);
    decide_bvs(w, seed, test, lane, road, tables);
    for (int64_t i = 1; i < n; i++)
        if (v[i].present) apply_action(w, i, v[i].action, accelerations, road);
    av_acts(w, command, lane, road);
    bool everybody = av->mobil.politeness > 0.0;
    double braking = everybody ? HARDEST_BRAKING : av->idm.max_braking;
    bound_motion(w, braking, everybody ? STRONGEST_ACCELERATION : av->idm.max_acceleration, pairs);
    int64_t n_pairs = find_pairs(w, road, pairs);
    choose_current(w, pairs, n_pairs, everybody, road);
    info[N_DECISIONS] += 1;
    for (int64_t substep = 0; substep < SUBSTEPS; substep++) {
        if (substep > 0 && substep % road->av_substeps == 0) {
            command = av_decide(w, road, av, &lane);
            av_acts(w, command, lane, road);
        }
        move(w, substep, road);
        int64_t frame = first_frame + substep + 1;
        bool ends = check_contacts(w, pairs, n_pairs, frame, road);
        if (!ends && v[0].x >= road->av_start + road->test_length) {
            info[OUTCOME] = COMPLETED;
            info[FRAME] = frame;
            ends = true;
        }
        if (ends) return;
    }
    if (info[N_DECISIONS] >= road->max_decisions) {
        info[OUTCOME] = TIME_UP;
        info[FRAME] = first_frame + SUBSTEPS;
    }
}

#endif
