/* src/cornerforge/sim/traffic.py */
#ifndef YARDSTICK_TRAFFIC_H
#define YARDSTICK_TRAFFIC_H

#include "drivers.h"
#include "geometry.h"
#include "philox.h"

enum { MAX_TRIES = 200 };

static double draw_speed(int64_t seed, int64_t test, const double *initial, int64_t *draw) {
    for (;;) {
        Words words = block(seed, test, (*draw)++, 0, PURPOSE_INITIAL);
        double z, unused;
        normal_pair(words.w[0], words.w[1], &z, &unused);
        double speed = initial[0] + initial[1] * z;
        if (initial[2] <= speed && speed <= initial[3]) return speed;
    }
}

/* Returns the gap; the neighbour's speed goes to *other. */
static double draw_neighbour(
    int64_t seed, int64_t test, const double *initial, int64_t *draw, double speed, bool ahead, double *other
) {
    for (int k = 0; k < MAX_TRIES; k++) {
        Words words = block(seed, test, (*draw)++, 0, PURPOSE_INITIAL);
        double z_gap, z_speed;
        normal_pair(words.w[0], words.w[1], &z_gap, &z_speed);
        bool follows = uniform(words.w[2]) < initial[4];
        double time_gap = initial[5] * exponential(initial[6] * z_gap);
        double gap = follows ? speed * time_gap : initial[10] + (initial[11] - initial[10]) * uniform(words.w[3]);
        double scale = initial[7] * exponential(initial[8] * logarithm(gap / 20.0));
        double drawn = initial[0] + (1.0 - scale * scale / (2.0 * initial[1] * initial[1])) * (speed - initial[0]) +
                       scale * z_speed;
        if (follows && !ahead) gap = drawn * time_gap;
        double closing = ahead ? speed - drawn : drawn - speed;
        bool legal = initial[2] <= drawn && drawn <= initial[3] && gap >= 1.0 && (!follows || gap <= initial[10]);
        if (legal && gap >= initial[9] * closing) {
            *other = drawn;
            return gap;
        }
    }
    *other = speed;
    return initial[11];
}

static void place(World *w, int64_t slot, double x, int64_t lane, double speed, const Road *road) {
    Vehicle *v = &w->v[slot];
    speed = MIN(speed, road->max_speed);
    v->x = x;
    v->y = lane_centre(lane, road->lane_width);
    v->speed = speed;
    v->x_held = x;
    v->speed_held = speed;
    v->lateral_speed = 0.0;
    v->heading = 0.0;
    v->acceleration = 0.0;
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

static int64_t fill_ahead(
    World *w, int64_t n, int64_t *draw, double x, double speed, int64_t lane, double first_gap, int64_t seed,
    int64_t test, const Road *road, const double *initial
) {
    for (;;) {
        double gap = draw_neighbour(seed, test, initial, draw, speed, true, &speed);
        x += road->length + MAX(gap, first_gap);
        first_gap = 0.0;
        if (x > road->traffic_length || n >= w->slots) return n;
        place(w, n++, x, lane, speed, road);
    }
}

static void reset_world(
    World *w, int64_t seed, int64_t test, const Road *road, const Av *av, const double *initial
) {
    for (int i = 0; i < INFO_FIELDS; i++) w->info[i] = 0;
    for (int64_t i = 0; i < w->slots; i++) w->v[i].present = 0;
    Words words = block(seed, test, 0, 0, PURPOSE_INITIAL);
    int64_t drawn_lane = (int64_t)floor(uniform(words.w[0]) * (double)road->n_lanes);
    int64_t av_lane = MIN(road->n_lanes - 1, drawn_lane);
    int64_t draw = 1;
    double speed = draw_speed(seed, test, initial, &draw);
    speed = MIN(speed, road->max_speed);
    place(w, 0, road->av_start, av_lane, speed, road);

    double lead_speed;
    double gap = draw_neighbour(seed, test, initial, &draw, speed, true, &lead_speed);
    double wanted = desired_gap(speed, lead_speed - speed, &av->idm);
    double x = road->av_start + road->length + MAX(gap, wanted);
    int64_t n = 1;
    if (x <= road->traffic_length) {
        place(w, n, x, av_lane, lead_speed, road);
        n = fill_ahead(w, n + 1, &draw, x, lead_speed, av_lane, 0.0, seed, test, road, initial);
    }
    x = road->av_start;
    for (;;) {
        gap = draw_neighbour(seed, test, initial, &draw, speed, false, &speed);
        x -= road->length + gap;
        if (x < 0.0 || n >= w->slots) break;
        place(w, n++, x, av_lane, speed, road);
    }
    for (int64_t lane = 0; lane < road->n_lanes; lane++) {
        if (lane == av_lane) continue;
        words = block(seed, test, draw++, 0, PURPOSE_INITIAL);
        speed = draw_speed(seed, test, initial, &draw);
        x = -initial[10] * uniform(words.w[0]);
        n = fill_ahead(w, n, &draw, x, speed, lane, 0.0, seed, test, road, initial);
    }
    w->info[N_VEHICLES] = n;
    w->info[CONTROLLED] = -1;
    for (int64_t i = 0; i < n; i++) w->order[i] = i;
    all_current(w);
}

#endif
