/* src/cornerforge/sim/sight.py, neighbours.py, actions.py, av.py and decide.py: the built-in AV and naturalistic BVs. */
#ifndef YARDSTICK_DECIDE_H
#define YARDSTICK_DECIDE_H

#include "drivers.h"
#include "geometry.h"
#include "philox.h"

#define SIGHT 200.0
#define CONFLICT_GAP 10.0
#define IGNORED_FROM 5.0

enum { ACTION_HOLD = 22 };

static const Sight HUMAN = {BY_MOTION, 0.375, 0.0, 1};
static const Sight FOLLOWED = {BY_MOTION, 0.55, 0.0, 0};

static inline int64_t lane_entered(const Vehicle *v, double lane_width, const Sight *sight) {
    if (sight->by == BY_DECISION || v->duration == 0.0 || (sight->by == BY_MOTION && sight->indicators && v->signals))
        return v->target_lane;
    int64_t own = lane_of(v->y, lane_width);
    if (sight->by == BY_CENTRE) return own;
    int64_t side = (v->lateral_speed > 0.0) - (v->lateral_speed < 0.0);
    int64_t entered = lane_of(v->y + (double)side * 0.5 * v->width, lane_width);
    if (entered == own) {
        double y = v->y, ago = sight->perception_time;
        if (ago > 0.0) y -= ago * (path_speed(v->c, v->clock) - 0.5 * ago * path_acceleration(v->c, v->clock));
        if ((double)side * (y - lane_centre(own, lane_width)) >= sight->offset) entered = own + side;
    }
    return MAX(0, entered);
}

static inline int64_t lanes_seen(const Vehicle *v, double lane_width, const Sight *sight) {
    if (sight->by == BY_DECISION || (sight->by == BY_MOTION && v->duration == 0.0)) return v->lanes;
    if (sight->by == BY_CENTRE) return (int64_t)1 << lane_of(v->y, lane_width);
    return lane_bits(v->y, 0.5 * v->width, lane_entered(v, lane_width, sight), lane_width);
}

static void known_neighbours(const World *w, int64_t lane, int64_t *lead, int64_t *rear) {
    const Vehicle *v = w->v;
    *lead = w->info[AV_LEADS + lane];
    *rear = w->info[AV_REARS + lane];
    if (*lead >= 0 && v[*lead].x - v[0].x >= SIGHT) *lead = -1;
    if (*rear >= 0 && v[0].x - v[*rear].x >= SIGHT) *rear = -1;
}

static void neighbours_in_lane(
    const World *w, int64_t i, int64_t lane, double lane_width, const Sight *sight, int64_t *lead, int64_t *rear
) {
    if (i == 0 && w->info[AV_LEADS + lane] != UNKNOWN) {
        known_neighbours(w, lane, lead, rear);
        return;
    }
    const Vehicle *v = w->v;
    const int64_t bit = (int64_t)1 << lane;
    double best_lead = SIGHT, best_rear = SIGHT;
    *lead = *rear = -1;
    for (int64_t k = 0; k < w->info[N_SEEN]; k++) {
        int64_t j = w->current[k];
        if (j == i) continue;
        double dx = v[j].x - v[i].x;
        if (dx > best_lead || -dx > best_rear) continue;
        if ((lanes_seen(&v[j], lane_width, sight) & bit) == 0) continue;
        if (dx > 0.0 || (dx == 0.0 && j > i)) {
            if (dx < best_lead) {
                best_lead = dx;
                *lead = j;
            }
        } else if (-dx < best_rear) {
            best_rear = -dx;
            *rear = j;
        }
    }
}

static void start_lane_change(World *w, int64_t i, int64_t target_lane, const Road *road) {
    Vehicle *v = &w->v[i];
    double acceleration = 0.0, speed = 0.0;
    if (v->duration > 0.0) {
        speed = path_speed(v->c, v->clock);
        acceleration = path_acceleration(v->c, v->clock);
    }
    v->target_lane = target_lane;
    v->clock = 0.0;
    v->duration = plan_path(
        v->c, v->y, speed, acceleration, lane_centre(target_lane, road->lane_width), v->change_time,
        road->max_lateral_acceleration
    );
    v->lanes |= (int64_t)1 << target_lane;
}

static double lead_acceleration(const World *w, int64_t i, int64_t lanes, const Road *road, const Av *av) {
    const Vehicle *v = w->v;
    double speed = v[i].speed;
    double command = free_acceleration(speed, &av->idm);
    for (int64_t lane = 0; lane < road->n_lanes; lane++) {
        if ((lanes & ((int64_t)1 << lane)) == 0) continue;
        int64_t lead, rear;
        neighbours_in_lane(w, i, lane, road->lane_width, &av->sight, &lead, &rear);
        if (lead >= 0) {
            double gap = v[lead].x - v[i].x - road->length;
            double behind = idm_acceleration(speed, gap, v[lead].speed - speed, &av->idm);
            command = MIN(command, behind);
        }
    }
    return command;
}

static double side_gain(
    const World *w, int64_t lane, double acceleration_now, double needed, const Road *road, const Av *av
) {
    const Vehicle *v = w->v;
    double speed = v[0].speed;
    double lead_gap = INFINITY, lead_speed = speed, rear_gap = INFINITY, rear_speed = speed, rear_now = 0.0;
    int64_t lead, rear;
    neighbours_in_lane(w, 0, lane, road->lane_width, &av->sight, &lead, &rear);
    if (lead >= 0) {
        lead_gap = v[lead].x - v[0].x - road->length;
        lead_speed = v[lead].speed;
    }
    if (av->mobil.politeness == 0.0 &&
        idm_acceleration(speed, lead_gap, lead_speed - speed, &av->idm) - acceleration_now <= needed)
        return needed;
    if (rear >= 0) {
        rear_gap = v[0].x - v[rear].x - road->length;
        rear_speed = v[rear].speed;
        if (av->mobil.politeness > 0.0)
            rear_now = lead_acceleration(w, rear, lanes_seen(&v[rear], road->lane_width, &av->sight), road, av);
    }
    return mobil_gain(
        speed, acceleration_now, lead_gap, lead_speed, rear_gap, rear_speed, rear_now, &av->idm, &av->mobil
    );
}

static bool must_give_way(const World *w, const Road *road, const Sight *sight) {
    const Vehicle *v = w->v;
    int64_t target = v[0].target_lane, old = lane_of(v[0].y, road->lane_width);
    if (old == target) return false;
    for (int64_t k = 0; k < w->info[N_CURRENT]; k++) {
        int64_t j = w->current[k];
        if (j > 0 && lane_entered(&v[j], road->lane_width, sight) == target) {
            int64_t other = lane_of(v[j].y, road->lane_width);
            if (other != target && other != old && fabs(v[j].x - v[0].x) < road->length + CONFLICT_GAP) return true;
        }
    }
    return false;
}

/* Returns the acceleration; the target lane goes to *lane. */
static double av_decide(const World *w, const Road *road, const Av *av, int64_t *lane) {
    const Vehicle *v = w->v;
    double command = lead_acceleration(w, 0, v[0].lanes, road, av);
    int64_t now = *lane = v[0].target_lane;
    if (v[0].duration > 0.0) {
        if (must_give_way(w, road, &av->sight)) *lane = lane_of(v[0].y, road->lane_width);
        return command;
    }
    double best_gain = av->mobil.min_gain;
    if (av->mobil.politeness == 0.0 && free_acceleration(v[0].speed, &av->idm) - command <= best_gain)
        return command;
    for (int64_t side = 1; side >= -1; side -= 2) {
        if (0 <= now + side && now + side < road->n_lanes) {
            double gain = side_gain(w, now + side, command, best_gain, road, av);
            if (gain > best_gain) {
                best_gain = gain;
                *lane = now + side;
            }
        }
    }
    return command;
}

/* Row and random word in one number, larger than any action: the look-up is put off, the row asked for now. */
static inline int64_t draw_later(const Tables *tables, int64_t row, uint64_t word, double noise) {
    __builtin_prefetch(&tables->cut[row * CUT_COLUMNS + FIRST_PROBE]);
    return (row + 1) << 32 | (int64_t)own_word(word, noise);
}

static inline int64_t drawn(const Tables *tables, int64_t action) {
    if (action <= 0xFFFFFFFF) return action;
    return 2 + sample_row(tables->cut, (action >> 32) - 1, (uint64_t)action & 0xFFFFFFFFu);
}

static int64_t worst_follow(
    const World *w, int64_t rank, const Road *road, const Tables *tables, uint64_t word, uint64_t follower_word,
    double rounding, double *gap, double *rate
) {
    const Vehicle *v = w->v;
    int64_t i = w->order[rank], wanted = v[i].lanes, action = -1;
    *gap = INFINITY;
    *rate = 0.0;
    for (int64_t other = rank + 1; other < w->info[N_VEHICLES]; other++) {
        int64_t j = w->order[other];
        double dx = v[j].x - v[i].x;
        if (dx >= SIGHT) break;
        if (v[j].present == 0) continue;
        int64_t seen = lanes_seen(&v[j], road->lane_width, &FOLLOWED);
        if ((seen & wanted) == 0) continue;
        double here = dx - road->length, closing = v[j].speed - v[i].speed;
        int64_t row = following_row(v[i].speed, v[i].desired_speed, here, closing, rounding);
        int64_t later = draw_later(tables, row, follower_word, v[i].noise);
        if (action < 0) {
            *gap = here;
            *rate = closing;
            action = later;
        } else {
            int64_t before = drawn(tables, action), now = drawn(tables, later);
            action = MIN(before, now);
        }
        wanted &= ~seen;
        if (wanted == 0) break;
    }
    return action < 0 ? draw_later(tables, free_row(v[i].speed, v[i].desired_speed), word, v[i].noise) : action;
}

static inline int64_t follow(
    const World *w, int64_t i, int64_t lead, const Road *road, const Tables *tables, uint64_t word,
    uint64_t follower_word, double rounding, double *gap, double *rate
) {
    const Vehicle *v = w->v;
    double speed = v[i].speed, dx = lead >= 0 ? v[lead].x - v[i].x : INFINITY;
    if (dx >= SIGHT) {
        *gap = INFINITY;
        *rate = 0.0;
        return draw_later(tables, free_row(speed, v[i].desired_speed), word, v[i].noise);
    }
    *gap = dx - road->length;
    *rate = v[lead].speed - speed;
    int64_t row = following_row(speed, v[i].desired_speed, *gap, *rate, rounding);
    return draw_later(tables, row, follower_word, v[i].noise);
}

static double side_chance(
    const World *w, int64_t i, int64_t lane, double base, double overlook, const Road *road, const Tables *tables
) {
    const Vehicle *v = w->v;
    int64_t lead, rear;
    neighbours_in_lane(w, i, lane, road->lane_width, &HUMAN, &lead, &rear);
    double chance = base;
    if (lead >= 0) {
        double gap = v[lead].x - v[i].x - road->length;
        chance *= overlook + (1.0 - overlook) * accept_chance(tables, 0, gap, v[lead].speed - v[i].speed);
    }
    if (rear >= 0) {
        double gap = v[i].x - v[rear].x - road->length;
        double accept = accept_chance(tables, 1, gap, v[i].speed - v[rear].speed);
        if (gap >= IGNORED_FROM) accept += road->ignored_rear * (1.0 - accept);
        chance *= overlook + (1.0 - overlook) * accept;
    }
    return chance;
}

static double turn_back_wish(const World *w, int64_t i, int64_t lane, const Road *road, const Tables *tables) {
    const Vehicle *v = w->v;
    int64_t lead, rear;
    neighbours_in_lane(w, i, lane, road->lane_width, &HUMAN, &lead, &rear);
    double wish = 0.0, behind = 0.0;
    if (lead >= 0) wish = turn_back_chance(tables, v[lead].x - v[i].x - road->length, v[lead].speed - v[i].speed);
    if (rear >= 0) behind = turn_back_chance(tables, v[i].x - v[rear].x - road->length, v[i].speed - v[rear].speed);
    return MAX(wish, behind);
}

static double return_chance(const World *w, int64_t i, double overlook, const Road *road, const Tables *tables) {
    const Vehicle *v = &w->v[i];
    int64_t old = lane_of(v->y, road->lane_width);
    if (old == v->target_lane) return 0.0;
    double wish = turn_back_wish(w, i, v->target_lane, road, tables);
    if (wish == 0.0 || turn_back_wish(w, i, old, road, tables) == 1.0) return 0.0;
    return (1.0 - overlook) * wish;
}

static inline uint64_t random_word(const World *w, int64_t k, int64_t i) { return w->words[k * w->slots + i]; }

/* A follower's second word becomes the one that its memory makes of it. */
static inline int64_t decide_naturalistic(
    const World *w, int64_t rank, const Road *road, const Tables *tables
) {
    const Vehicle *v = w->v;
    int64_t i = w->order[rank];
    uint64_t word = random_word(w, 1, i);
    uint64_t follower_word = remembering_word(word, v[i].quantile, v[i].habit, &tables->memory);
    double gap, rate, rounding = uniform(random_word(w, 3, i));
    int64_t lead = w->info[AHEAD + v[i].target_lane];
    int64_t action = keeps_one_lane(&v[i])
        ? follow(w, i, lead, road, tables, word, follower_word, rounding, &gap, &rate)
        : worst_follow(w, rank, road, tables, word, follower_word, rounding, &gap, &rate);
    if (gap < INFINITY) w->words[w->slots + i] = follower_word;
    if (v[i].duration == 0.0) {
        double draw = uniform(random_word(w, 0, i));
        if (draw >= 2.0 * tables->lc_most) return action;
        double base = lane_change_base(tables, v[i].speed, gap, rate);
        if (draw < 2.0 * base) {
            int64_t lane = v[i].target_lane;
            double left = 0.0;
            if (lane + 1 < road->n_lanes) {
                left = side_chance(w, i, lane + 1, base, tables->overlook, road, tables);
                if (draw < left) return 0;
            }
            if (lane > 0 && draw < left + side_chance(w, i, lane - 1, base, tables->overlook, road, tables)) return 1;
        }
    } else if (uniform(random_word(w, 0, i)) < return_chance(w, i, tables->overlook, road, tables)) {
        return lane_of(v[i].y, road->lane_width) > v[i].target_lane ? 0 : 1;
    }
    return action;
}

static bool starts_into(const Vehicle *v, int64_t j, int64_t lane, int64_t av_lane) {
    if (v[j].present == 0 || v[j].target_lane == lane) return false;
    if (j == 0) return av_lane == lane;
    return 0 <= v[j].action && v[j].action <= 1 && v[j].target_lane + 1 - 2 * v[j].action == lane;
}

static bool gives_way(
    const World *w, int64_t i, int64_t target, int64_t av_lane, const Road *road, const Tables *tables
) {
    const Vehicle *v = w->v;
    double chance = 1.0;
    for (int64_t j = 0; j < w->info[N_VEHICLES]; j++) {
        double dx = v[j].x - v[i].x;
        if (dx < 0.0 || dx >= SIGHT || j == i || (dx == 0.0 && j < i) || !starts_into(v, j, target, av_lane)) continue;
        double accept = accept_chance(tables, 0, dx - road->length, v[j].speed - v[i].speed);
        chance = MIN(chance, accept);
    }
    if (chance >= 1.0) return false;
    return uniform(random_word(w, 2, i)) >= tables->overlook_conflict + (1.0 - tables->overlook_conflict) * chance;
}

static void hold(Vehicle *v, double acceleration, const Road *road) {
    v->commanded = acceleration;
    if (road->ramp_time == 0.0) v->acceleration = acceleration;
    double now = v->acceleration, change = acceleration - now, ramp = fabs(change) * road->ramp_time;
    double most = MAX(fabs(now), fabs(acceleration)) * ramp;
    v->x_held = v->x;
    if (ramp <= DT && most <= v->speed && v->speed + most <= road->max_speed) {
        v->acceleration_held = acceleration;
        v->x_held += 1.0 / 6.0 * change * ramp * ramp;
        v->speed_held = v->speed - 0.5 * change * ramp;
    } else {
        v->acceleration_held = now;
        v->speed_held = v->speed;
    }
}

static void apply_action(World *w, int64_t i, int64_t action, const double *accelerations, const Road *road) {
    Vehicle *v = &w->v[i];
    if (action >= 2) {
        hold(v, accelerations[action - 2], road);
        return;
    }
    hold(v, 0.0, road);
    int64_t side = 1 - 2 * action, target = v->target_lane + side;
    if (v->duration > 0.0) {
        int64_t running = v->c[0] < lane_centre(v->target_lane, road->lane_width) ? 1 : -1;
        if (running == side) return;
    }
    if (0 <= target && target < road->n_lanes) start_lane_change(w, i, target, road);
}

static void sort_by_x(World *w) {
    const Vehicle *v = w->v;
    int64_t *order = w->order;
    for (int64_t rank = 1; rank < w->info[N_VEHICLES]; rank++) {
        int64_t i = order[rank], spot = rank;
        double x = v[i].x;
        while (spot > 0) {
            int64_t before = order[spot - 1];
            if (v[before].x < x || (v[before].x == x && before < i)) break;
            order[spot--] = before;
        }
        order[spot] = i;
    }
}

static bool looks_away(World *w, int64_t i, const Tables *tables) {
    uint64_t low = (random_word(w, 2, i) & 0xFFFFu) | (random_word(w, 3, i) & 0xFFFFu) << 16;
    double chance = w->v[i].away ? tables->memory.away_again : w->v[i].inattention * tables->memory.away;
    w->v[i].away = uniform(low) < chance;
    if (w->v[i].away) w->words[w->slots + i] = (uint64_t)(w->v[i].quantile * 4294967296.0);
    return w->v[i].away;
}

static int64_t all_naturalistic(World *w, int64_t seed, int64_t test, const Road *road, const Tables *tables) {
    Vehicle *v = w->v;
    int64_t *ahead = w->info + AHEAD, changes = 0;
    blocks(w->words, w->slots, seed, test, w->info[N_DECISIONS], w->info[N_VEHICLES], PURPOSE_DECIDE);
    for (int64_t lane = 0; lane < road->n_lanes; lane++) ahead[lane] = -1;
    for (int64_t rank = w->info[N_VEHICLES] - 1; rank >= 0; rank--) {
        int64_t i = w->order[rank];
        if (v[i].present == 0) continue;
        if (i > 0) {
            v[i].action = looks_away(w, i, tables) ? ACTION_HOLD : decide_naturalistic(w, rank, road, tables);
            if (v[i].action < 2) changes++;
        }
        int64_t seen = lanes_seen(&v[i], road->lane_width, &FOLLOWED);
        for (int64_t lane = 0; lane < road->n_lanes; lane++)
            if (seen & ((int64_t)1 << lane)) ahead[lane] = i;
    }
    for (int64_t i = 1; i < w->info[N_VEHICLES]; i++) {
        v[i].action = drawn(tables, v[i].action);
        v[i].quantile = uniform(random_word(w, 1, i));
    }
    return changes;
}

static void resolve_conflicts(World *w, int64_t av_lane, const Road *road, const Tables *tables) {
    Vehicle *v = w->v;
    for (int64_t rank = w->info[N_VEHICLES] - 1; rank >= 0; rank--) {
        int64_t i = w->order[rank];
        if (i == 0 || v[i].present == 0 || v[i].action < 0 || v[i].action > 1) continue;
        if (v[i].duration > 0.0) continue;
        int64_t target = v[i].target_lane + 1 - 2 * v[i].action;
        if (gives_way(w, i, target, av_lane, road, tables)) {
            uint64_t word = random_word(w, 1, i);
            double gap, rate, rounding = uniform(random_word(w, 3, i));
            int64_t action = worst_follow(w, rank, road, tables, word, word, rounding, &gap, &rate);
            v[i].action = drawn(tables, action);
        }
    }
}

static void decide_bvs(
    World *w, int64_t seed, int64_t test, int64_t av_lane, const Road *road, const Tables *tables
) {
    sort_by_x(w);
    int64_t changes = all_naturalistic(w, seed, test, road, tables);
    if (changes + (av_lane != w->v[0].target_lane) > 1) resolve_conflicts(w, av_lane, road, tables);
}

#endif
