/* State and constants of a world: a vehicle is laid out as in src/cornerforge/sim/world.py, the rest as in
 * benchmarks/yardstick.py, which allocates it. */
#ifndef YARDSTICK_WORLD_H
#define YARDSTICK_WORLD_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define DT 0.1

/* Python's max(a, b) and min(a, b): the first unless the second is really larger (smaller). */
#define MAX(a, b) ((b) > (a) ? (b) : (a))
#define MIN(a, b) ((b) < (a) ? (b) : (a))

typedef struct {
    double x, y, speed, x_held, speed_held, lateral_speed, heading, acceleration, clock, duration;
    double c[6];
    int64_t target_lane, lanes, present, action;
    double length, width; /* of the kernels; all are cars here, of the road's size */
    int64_t kind;
    double quantile, habit, desired_speed, change_time;
    int32_t signals, away;
    double commanded, acceleration_held, noise, inattention;
} Vehicle;

enum { N_VEHICLES, N_DECISIONS, CONTROLLED, OUTCOME, FRAME, SLOT_A, SLOT_B, N_BV_CRASHES, N_CURRENT, N_SEEN };
enum { BUDGET_LEFT = 10, AV_LEADS = 11, MAX_LANES = 6 };
enum { AV_REARS = AV_LEADS + MAX_LANES, AHEAD = AV_REARS + MAX_LANES, INFO_FIELDS = AHEAD + MAX_LANES, UNKNOWN = -2 };
enum { RUNNING, COMPLETED, AV_CRASH, BV_CRASH, TIME_UP };

typedef struct {
    Vehicle *v;
    int64_t *order, *current, *info;
    uint64_t *words; /* (4, slots) */
    int64_t slots;
} World;

typedef struct {
    int64_t n_lanes;
    double lane_width, length, width, max_speed, lane_change_duration, max_lateral_acceleration, test_length;
    int64_t max_decisions;
    double av_start, traffic_length;
    int64_t av_substeps;
    double truck_share, motorcycle_share, ignored_rear, longest, widest;
    int64_t one_size, same_duration;
    double max_jerk, ramp_time, slower_right;
    int64_t truck_lanes;
} Road;

typedef struct {
    double max_acceleration, comfortable_braking, standstill_gap, time_gap, desired_speed, max_braking;
} Idm;

typedef struct {
    double politeness, min_gain, max_imposed_braking;
} Mobil;

enum { BY_CENTRE, BY_DECISION, BY_MOTION };

typedef struct {
    int64_t by;
    double offset, perception_time;
    int64_t indicators;
} Sight;

typedef struct {
    Idm idm;
    Mobil mobil;
    Sight sight;
} Av;

typedef struct {
    double near, near_width, far, far_width, habit, habit_width, away, away_again, ways[16];
} Memory;

typedef struct {
    double speed_mean, stream_sd, speed_sd, speed_low, speed_high, follow_share, time_gap_shift, time_gap_median;
    double time_gap_sigma, desire_share, habit_spread, rr_scale, rr_exponent, min_ttc, free_gap_low, free_gap_high;
    double change_median, change_sigma, change_low, change_high, signal_share;
} Initial;

typedef struct {
    const uint32_t *cut;
    const float *lc_base, *lc_desire, *lc_accept, *lc_turn_back;
    double lc_desire_free, overlook, overlook_conflict, lc_most;
    Memory memory;
    Initial initial;
    const double *noise, *inattention;
} Tables;

typedef struct {
    int64_t *a, *b;
    double *least, *most;
    int64_t *is_watched;
    double *ahead, *behind;
    int64_t capacity;
} Pairs;

static inline void forget_av_neighbours(World *w) {
    for (int64_t place = AV_LEADS; place < AV_REARS + MAX_LANES; place++) w->info[place] = UNKNOWN;
}

static inline bool keeps_one_lane(const Vehicle *v) { return v->lanes == (int64_t)1 << v->target_lane; }

static void list_all(World *w) {
    int64_t found = 0;
    for (int64_t i = 0; i < w->info[N_VEHICLES]; i++)
        if (w->v[i].present) w->current[found++] = i;
    w->info[N_CURRENT] = found;
    w->info[N_SEEN] = found;
}

static void all_current(World *w) {
    list_all(w);
    forget_av_neighbours(w);
}

#endif
