/* src/cornerforge/sim/traffic.py */
#ifndef YARDSTICK_TRAFFIC_H
#define YARDSTICK_TRAFFIC_H

#include "drivers.h"
#include "geometry.h"
#include "philox.h"

enum { MAX_TRIES = 200 };

static double draw_speed(int64_t seed, int64_t test, const Initial *initial, double mean, int64_t *draw) {
    for (;;) {
        Words words = block(seed, test, (*draw)++, 0, PURPOSE_INITIAL);
        double z, unused;
        normal_pair(words.w[0], words.w[1], &z, &unused);
        double speed = mean + initial->speed_sd * z;
        if (initial->speed_low <= speed && speed <= initial->speed_high) return speed;
    }
}

static inline double normal_share(double z) {
    double t = 1.0 / (1.0 + 0.2316419 * fabs(z));
    double series = 1.330274429 * t - 1.821255978;
    series = series * t + 1.781477937;
    series = series * t - 0.356563782;
    series = series * t + 0.319381530;
    double tail = 0.3989422804014327 * exponential(-0.5 * z * z) * series * t;
    return z < 0.0 ? tail : 1.0 - tail;
}

/* Returns the gap; the neighbour's speed goes to *other, the quantile of the time gap (-1: it does not follow) to
 * *quantile. */
static double draw_neighbour(
    int64_t seed, int64_t test, const Tables *tables, double mean, int64_t *draw, double speed, bool ahead,
    double *other, double *quantile
) {
    const Initial *initial = &tables->initial;
    for (int k = 0; k < MAX_TRIES; k++) {
        Words words = block(seed, test, (*draw)++, 0, PURPOSE_INITIAL);
        double z_gap, z_speed;
        normal_pair(words.w[0], words.w[1], &z_gap, &z_speed);
        bool follows = uniform(words.w[2]) < initial->follow_share;
        double time_gap =
            initial->time_gap_shift + initial->time_gap_median * exponential(initial->time_gap_sigma * z_gap);
        double free_gap =
            initial->free_gap_low + (initial->free_gap_high - initial->free_gap_low) * uniform(words.w[3]);
        double gap = follows ? speed * time_gap : free_gap;
        double scale = initial->rr_scale * exponential(initial->rr_exponent * logarithm(gap / 20.0));
        scale = MIN(scale, initial->speed_sd);
        double share = scale / initial->speed_sd;
        double drawn = mean + sqrt(1.0 - share * share) * (speed - mean) + scale * z_speed;
        if (follows && !ahead) gap = drawn * time_gap;
        double closing = ahead ? speed - drawn : drawn - speed;
        bool is_near = !follows || gap <= initial->free_gap_low;
        bool legal = initial->speed_low <= drawn && drawn <= initial->speed_high && gap >= 1.0 && is_near;
        if (legal && gap >= initial->min_ttc * closing) {
            *other = drawn;
            *quantile = follows && tables->memory.habit > 0.0 ? normal_share(z_gap) : -1.0;
            return gap;
        }
    }
    *other = speed;
    *quantile = -1.0;
    return initial->free_gap_high;
}

static void give_habit(Vehicle *v, double quantile, const Initial *initial) {
    if (quantile >= 0.0)
        v->habit = reflected(1.0 - quantile + initial->habit_spread * (2.0 * v->habit - 1.0));
}

static void draw_traits(World *w, int64_t slot, int64_t seed, int64_t test, const Tables *tables) {
    Words words = block(seed, test, slot, 0, PURPOSE_TRAITS);
    w->v[slot].quantile = uniform(words.w[0]);
    w->v[slot].habit = uniform(words.w[1]);
    normal_pair(words.w[2], words.w[3], &w->v[slot].desired_speed, &w->v[slot].change_time);
    w->v[slot].signals = (int32_t)(words.w[0] & 1023);
    w->v[slot].noise = tables->noise[words.w[1] & 1023];
    w->v[slot].inattention = tables->inattention[words.w[1] >> 10 & 1023];
}

static void place(
    World *w, int64_t slot, double x, int64_t lane, double speed, double mean, const Road *road, const Initial *initial
) {
    Vehicle *v = &w->v[slot];
    speed = MIN(speed, road->max_speed);
    double share = initial->desire_share;
    double noise = sqrt(share * (1.0 - share)) * initial->speed_sd * v->desired_speed;
    v->desired_speed = mean + share * (speed - mean) + noise;
    if (slot == 0 || road->same_duration || initial->change_median == 0.0) {
        v->change_time = road->lane_change_duration;
    } else {
        double time = initial->change_median * exponential(initial->change_sigma * v->change_time);
        v->change_time = MIN(MAX(time, initial->change_low), initial->change_high);
    }
    v->away = 0;
    v->signals = slot == 0 || (double)v->signals < initial->signal_share * 1024.0;
    v->x = x;
    v->y = lane_centre(lane, road->lane_width);
    v->speed = speed;
    v->x_held = x;
    v->speed_held = speed;
    v->lateral_speed = 0.0;
    v->heading = 0.0;
    v->acceleration = v->commanded = v->acceleration_held = 0.0;
    v->clock = 0.0;
    v->duration = 0.0;
    v->target_lane = lane;
    v->lanes = (int64_t)1 << lane;
    v->present = 1;
    v->length = road->length;
    v->width = road->width;
    v->kind = 0;
    v->action = -1;
}

/* Adds vehicles from slot n on, ahead of one at x (slot `rear`, -1: not there); returns how many there are then. */
static int64_t fill_ahead(
    World *w, int64_t n, int64_t *draw, double x, double speed, double mean, int64_t lane, int64_t rear, int64_t seed,
    int64_t test, const Road *road, const Tables *tables
) {
    const Initial *initial = &tables->initial;
    for (;;) {
        double quantile, gap = draw_neighbour(seed, test, tables, mean, draw, speed, true, &speed, &quantile);
        if (rear >= 0) give_habit(&w->v[rear], quantile, initial);
        x += road->length + gap;
        if (x > road->traffic_length || n >= w->slots) return n;
        draw_traits(w, n, seed, test, tables);
        place(w, n, x, lane, speed, mean, road, initial);
        rear = n++;
    }
}

static void reset_world(
    World *w, int64_t seed, int64_t test, const Road *road, const Av *av, const Tables *tables
) {
    const Initial *initial = &tables->initial;
    for (int i = 0; i < INFO_FIELDS; i++) w->info[i] = 0;
    for (int64_t i = 0; i < w->slots; i++) w->v[i].present = 0;
    int64_t draw = 0;
    Words words = block(seed, test, draw++, 0, PURPOSE_INITIAL);
    int64_t drawn_lane = (int64_t)floor(uniform(words.w[0]) * (double)road->n_lanes);
    int64_t av_lane = MIN(road->n_lanes - 1, drawn_lane);
    words = block(seed, test, draw++, 0, PURPOSE_INITIAL);
    double z, unused;
    normal_pair(words.w[0], words.w[1], &z, &unused);
    double mean = initial->speed_mean + initial->stream_sd * z;
    mean = MIN(initial->speed_high, mean);
    mean = MAX(initial->speed_low, mean);
    double speed = draw_speed(seed, test, initial, mean, &draw);
    speed = MIN(speed, road->max_speed);
    draw_traits(w, 0, seed, test, tables);
    place(w, 0, road->av_start, av_lane, speed, mean, road, initial);

    double lead_speed, quantile;
    double gap = draw_neighbour(seed, test, tables, mean, &draw, speed, true, &lead_speed, &quantile);
    double wanted = desired_gap(speed, lead_speed - speed, &av->idm);
    double x = road->av_start + road->length + MAX(gap, wanted);
    int64_t n = 1;
    if (x <= road->traffic_length) {
        draw_traits(w, n, seed, test, tables);
        place(w, n, x, av_lane, lead_speed, mean, road, initial);
        n = fill_ahead(w, n + 1, &draw, x, lead_speed, mean, av_lane, n, seed, test, road, tables);
    }
    x = road->av_start;
    for (;;) {
        gap = draw_neighbour(seed, test, tables, mean, &draw, speed, false, &speed, &quantile);
        x -= road->length + gap;
        if (x < 0.0 || n >= w->slots) break;
        draw_traits(w, n, seed, test, tables);
        give_habit(&w->v[n], quantile, initial);
        place(w, n++, x, av_lane, speed, mean, road, initial);
    }
    for (int64_t lane = 0; lane < road->n_lanes; lane++) {
        if (lane == av_lane) continue;
        words = block(seed, test, draw++, 0, PURPOSE_INITIAL);
        speed = draw_speed(seed, test, initial, mean, &draw);
        x = -initial->free_gap_low * uniform(words.w[0]);
        n = fill_ahead(w, n, &draw, x, speed, mean, lane, -1, seed, test, road, tables);
    }
    w->info[N_VEHICLES] = n;
    w->info[CONTROLLED] = -1;
    for (int64_t i = 0; i < n; i++) w->order[i] = i;
    all_current(w);
}

#endif
